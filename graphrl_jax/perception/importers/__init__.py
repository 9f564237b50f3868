"""Import of demonstrations: videos, folders of frames, MAGICAL's trajectories, datasets of robots, ready-made boxes.

`magical`, `videos`, `images`, `lerobot`, `robomimic`, `labels` and `coco` read recordings; `names` and `sequences` tell
from file names which frames make one and in what order; `clips` cuts episodes out of longer files; `convert` detects
and tracks objects and makes demonstrations.
"""
