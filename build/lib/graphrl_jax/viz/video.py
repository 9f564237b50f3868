"""Writing of frames in memory to an mp4 file."""

from pathlib import Path

import imageio.v2 as imageio
import numpy as np

from graphrl_jax.storage import write_atomically


def write_video(frames: np.ndarray, path: str | Path, frame_rate: float) -> None:
    """Writes an H.264 mp4 file, atomically; missing folders are created.

    Args:
      frames: (T, H, W, 3) uint8, T at least 1. The codec needs even sizes, so an odd H or W is padded by one pixel that
        repeats the edge.
      path: ends in .mp4.
      frame_rate: frames per second.

    Raises:
      ValueError: no frames, a wrong shape or dtype, a name that does not end in .mp4, or a frame rate not above 0.
    """
    path, frames = Path(path), np.asarray(frames)
    if frames.ndim != 4 or frames.shape[-1] != 3 or frames.dtype != np.uint8:
        raise ValueError(f"frames must be uint8 of shape (T, H, W, 3), got {frames.dtype} of shape {frames.shape}")
    if not frames.size:
        raise ValueError(f"a video needs at least one frame of at least one pixel, got shape {frames.shape}")
    if path.suffix != ".mp4":
        raise ValueError(f"a video's name must end in .mp4, got {path}")
    if not frame_rate > 0:
        raise ValueError(f"frame_rate must be above 0, got {frame_rate}")
    height, width = frames.shape[1:3]
    frames = np.pad(frames, ((0, 0), (0, height % 2), (0, width % 2), (0, 0)), mode="edge")

    def write(temporary: Path) -> None:
        # macro_block_size 1 keeps the size instead of scaling to multiples of 16.
        with imageio.get_writer(temporary, fps=frame_rate, codec="libx264", quality=7, macro_block_size=1) as writer:
            for frame in frames:
                writer.append_data(frame)

    write_atomically(path, write)
