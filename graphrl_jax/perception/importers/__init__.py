"""Import of demonstrations: videos, folders of frames, MAGICAL's trajectories, ready-made boxes.

`magical`, `images` and `labels` read recordings; `convert` detects and tracks objects and makes demonstrations.
"""
