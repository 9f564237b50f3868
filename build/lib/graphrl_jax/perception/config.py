"""Names shared by commands and importers. Plain Python, so that commands start without JAX."""

from typing import Literal, get_args

Format = Literal[
    "magical", "video", "frames", "coco", "yolo", "corners", "cvat", "mot", "label_studio", "masks", "lerobot",
    "robomimic",
]  # fmt: skip
FORMATS: tuple[str, ...] = get_args(Format)
"""Formats of recordings."""
SIZED_FORMATS = ("corners", "cvat", "mot", "label_studio")
"""Formats in pixels or with turned boxes whose files need not tell the size of the images."""
CAMERA_FORMATS = ("lerobot", "robomimic")
"""Formats whose recordings may have several cameras."""
