"""Reader of frame folders, as in XIRL's datasets: a folder per demonstration, frames named by number."""

from pathlib import Path
from typing import BinaryIO

import numpy as np
from PIL import Image, ImageOps

from graphrl_jax.perception.importers.recording import ImportFailure, Recording, Recordings, folders_of
from graphrl_jax.perception.importers.sequences import sequences

IMAGE_ENDINGS = (".png", ".jpg", ".jpeg", ".bmp")
_DEEP_MODES = ("I", "F")


def read_frame_folders(files: list[Path]) -> Recordings:
    """Yields a recording per sequence of frames in a folder.

    Raises:
      ImportFailure: see `sequences`; a file is no image of 8 bits, or the frames of a recording differ in size.
    """
    for folder, paths in folders_of(files).items():
        found = sequences(paths)
        for sequence in found:
            frames: list[np.ndarray] = []
            for path in map(Path, sequence.paths):
                frame = read_image(path, str(path))
                if frames and frame.shape != frames[0].shape:
                    sizes = [f"{shape[1]} x {shape[0]}" for shape in (frame.shape, frames[0].shape)]
                    raise ImportFailure(f"{path}: the frame is {sizes[0]}, but the recording's first one {sizes[1]}")
                frames.append(frame)
            yield Recording(sequence.source(folder, found), np.stack(frames))


def read_image(file: Path | BinaryIO, where: str) -> np.ndarray:
    """An image (H, W, 3) uint8, upright as its EXIF data say it; `where` names it in messages.

    Raises:
      ImportFailure: it is no image, or has more than 8 bits for each channel.
    """
    try:
        with Image.open(file) as image:
            mode = image.mode
            pixels = np.asarray(ImageOps.exif_transpose(image).convert("RGB"))
    except Exception as error:  # every format raises other types
        raise ImportFailure(f"{where}: no image that can be read: {error}") from None
    if mode.partition(";")[0] in _DEEP_MODES:
        raise ImportFailure(f"{where}: the pixels are of Pillow's mode {mode}; allowed: 8 bits for each channel")
    return pixels
