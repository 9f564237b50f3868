"""Import of demonstrations: videos, folders of frames, MAGICAL's trajectories, ready-made boxes.

`magical`, `videos`, `images`, `labels` and `coco` read recordings; `names` and `sequences` tell from file names which
frames make one and in what order; `convert` detects and tracks objects and makes demonstrations.
"""
