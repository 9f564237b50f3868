"""Import of demonstrations: videos, folders of frames, MAGICAL's trajectories, datasets of robots, ready-made boxes and
masks.

`magical`, `videos`, `images`, `lerobot`, `robomimic`, `labels`, `coco`, `cvat`, `mot`, `label_studio` and `masks` read
recordings; `names` and `sequences` tell from file names which frames make one and in what order, `listings` does so for
images that one file lists; `clips` cuts episodes out of longer files, and `key_frames` fills tracks in; `classes`
reads the classes of an export; `convert` detects and tracks objects and makes demonstrations.
"""
