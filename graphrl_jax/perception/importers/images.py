"""Readers of videos, and of frame folders as in XIRL's datasets: a folder per demonstration, frames named by number."""

from pathlib import Path

import imageio.v3 as imageio
import numpy as np

from graphrl_jax.perception.importers.recording import ImportFailure, Recording, Recordings, folders_of

IMAGE_ENDINGS = (".png", ".jpg", ".jpeg", ".bmp")
VIDEO_ENDINGS = (".mp4", ".gif", ".avi", ".mov", ".mkv", ".webm")


def read_videos(files: list[Path]) -> Recordings:
    """Yields a recording per video file."""
    for path in files:
        try:
            frames = np.asarray(imageio.imread(path, index=None))
            about = imageio.immeta(path, exclude_applied=False)
        except Exception as error:  # every plugin raises other types
            raise ImportFailure(f"{path}: no video that can be read: {error or type(error).__name__}") from None
        if frames.ndim != 4 or not len(frames):
            raise ImportFailure(f"{path}: a video without frames")
        # A GIF has the duration of a frame in milliseconds.
        rate = about.get("fps") or 1000 / (about.get("duration") or np.inf)
        yield Recording(path, _colour(frames, path), frame_rate=rate or None)


def read_frame_folders(files: list[Path]) -> Recordings:
    """Yields a recording per folder of images, with frames in the given order."""
    for folder, paths in folders_of(files).items():
        frames: list[np.ndarray] = []
        for path in paths:
            try:
                frame = _colour(np.asarray(imageio.imread(path))[None], path)[0]
            except ImportFailure:
                raise
            except Exception as error:
                raise ImportFailure(f"{path}: no image that can be read: {error}") from None
            if frames and frame.shape != frames[0].shape:
                sizes = [f"{shape[1]} x {shape[0]}" for shape in (frame.shape, frames[0].shape)]
                raise ImportFailure(f"{path}: the frame is {sizes[0]}, but the folder's first one {sizes[1]}")
            frames.append(frame)
        yield Recording(folder, np.stack(frames))


def _colour(frames: np.ndarray, path: Path) -> np.ndarray:
    """Frames (T, H, W, 3) uint8 from grey, coloured or transparent frames."""
    if frames.dtype != np.uint8:
        raise ImportFailure(f"{path}: the pixels are {frames.dtype}; allowed: uint8")
    if frames.ndim == 3:
        frames = np.repeat(frames[..., None], 3, axis=-1)
    if frames.ndim != 4 or frames.shape[-1] not in (3, 4):
        raise ImportFailure(f"{path}: the shape is {frames.shape[1:]}; allowed: (H, W), (H, W, 3) and (H, W, 4)")
    return frames[..., :3]
