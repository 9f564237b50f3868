"""Videos, and folders of frames as XIRL's datasets have them: one folder per demonstration, frames named by number."""

import re
from pathlib import Path

import imageio.v3 as imageio
import numpy as np

from graphrl_jax.importers.recording import ImportFailure, Recording, Recordings

PICTURES = (".png", ".jpg", ".jpeg", ".bmp")
VIDEOS = (".mp4", ".gif", ".avi", ".mov", ".mkv", ".webm")


def read_videos(source: Path) -> Recordings:
    """Recordings of a video file or of all in a folder, in order of their names."""
    for path in [source] if source.is_file() else sorted(p for p in source.iterdir() if p.suffix.lower() in VIDEOS):
        try:
            frames = np.asarray(imageio.imread(path, index=None))
        except Exception as error:  # every plugin has its own
            raise ImportFailure(f"{path}: no video that can be read: {error or type(error).__name__}") from None
        if frames.ndim != 4 or not len(frames):
            raise ImportFailure(f"{path}: a video without frames")
        yield Recording(path, _colour(frames, path))


def read_frame_folders(source: Path) -> Recordings:
    """A recording per folder that holds pictures, at any depth, in order of their names."""
    folders = sorted({path.parent for path in source.rglob("*") if path.suffix.lower() in PICTURES})
    for folder in folders:
        frames: list[np.ndarray] = []
        for path in in_order(p for p in folder.iterdir() if p.suffix.lower() in PICTURES):
            try:
                frame = _colour(np.asarray(imageio.imread(path))[None], path)[0]
            except ImportFailure:
                raise
            except Exception as error:
                raise ImportFailure(f"{path}: no picture that can be read: {error}") from None
            if frames and frame.shape != frames[0].shape:
                sizes = [f"{shape[1]} x {shape[0]}" for shape in (frame.shape, frames[0].shape)]
                raise ImportFailure(f"{path}: the frame is {sizes[0]}, but the folder's first one {sizes[1]}")
            frames.append(frame)
        yield Recording(folder, np.stack(frames))


def in_order(paths) -> list[Path]:
    """Paths by the numbers in their names: 2 before 10."""
    return sorted(paths, key=lambda path: [int(p) if p.isdigit() else p for p in re.split(r"(\d+)", path.name)])


def _colour(frames: np.ndarray, path: Path) -> np.ndarray:
    """Frames (T, H, W, 3) uint8 of grey, coloured or transparent ones."""
    if frames.dtype != np.uint8:
        raise ImportFailure(f"{path}: the pixels are {frames.dtype}; allowed: uint8")
    if frames.ndim == 3:
        frames = np.repeat(frames[..., None], 3, axis=-1)
    if frames.ndim != 4 or frames.shape[-1] not in (3, 4):
        raise ImportFailure(f"{path}: the shape is {frames.shape[1:]}; allowed: (H, W), (H, W, 3) and (H, W, 4)")
    return frames[..., :3]
