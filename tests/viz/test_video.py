"""Videos read back with the frames and the size that were written."""

from pathlib import Path

import imageio.v3 as imageio
import numpy as np
import pytest

from graphrl_jax.viz.video import write_video


def moving_square(frames: int, height: int, width: int) -> np.ndarray:
    """(T, H, W, 3): a white square that moves right over black."""
    video = np.zeros((frames, height, width, 3), np.uint8)
    for t in range(frames):
        video[t, 8:24, 2 * t : 2 * t + 16] = 255
    return video


@pytest.mark.parametrize(("height", "width"), [(48, 64), (47, 63)])
def test_video_reads_back(tmp_path: Path, height: int, width: int) -> None:
    frames = moving_square(9, height, width)
    path = tmp_path / "videos" / "rollout.mp4"
    write_video(frames, path, 8.0)
    seconds = imageio.immeta(path, exclude_applied=False)["duration"]
    read = np.asarray(imageio.imread(path, index=None))
    assert read.shape == (9, 48, 64, 3)
    assert seconds == pytest.approx(9 / 8, abs=0.05)
    assert np.mean(np.abs(read[:, :height, :width].astype(float) - frames)) < 10
    assert list(path.parent.iterdir()) == [path]


@pytest.mark.parametrize(
    ("frames", "name", "frame_rate", "message"),
    [
        (np.zeros((0, 8, 8, 3), np.uint8), "a.mp4", 8.0, "at least one frame"),
        (np.zeros((8, 8, 3), np.uint8), "a.mp4", 8.0, r"\(8, 8, 3\)"),
        (np.zeros((2, 8, 8, 4), np.uint8), "a.mp4", 8.0, r"\(2, 8, 8, 4\)"),
        (np.zeros((2, 8, 8, 3), np.float32), "a.mp4", 8.0, "float32"),
        (np.zeros((2, 8, 8, 3), np.uint8), "a.avi", 8.0, "a.avi"),
        (np.zeros((2, 8, 8, 3), np.uint8), "a.mp4", 0.0, "frame_rate"),
    ],
)
def test_bad_input_is_named_and_writes_nothing(
    tmp_path: Path, frames: np.ndarray, name: str, frame_rate: float, message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        write_video(frames, tmp_path / name, frame_rate)
    assert not list(tmp_path.iterdir())
