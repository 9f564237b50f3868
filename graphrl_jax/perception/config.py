"""Names shared by commands and importers. Plain Python, so that commands start without JAX."""

from typing import Literal, get_args

Format = Literal["magical", "video", "frames", "coco", "yolo", "corners", "lerobot", "robomimic"]
FORMATS: tuple[str, ...] = get_args(Format)
"""Formats of recordings."""
CAMERA_FORMATS = ("lerobot", "robomimic")
"""Formats whose recordings may have several cameras."""
