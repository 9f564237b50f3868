"""Videos as GIFs: size, speed, and what is no video."""

import io

import numpy as np
import PIL.Image
import pytest

from graphrl_jax.viz.gif import as_gif
from graphrl_jax.viz.video import write_video


@pytest.mark.parametrize("width, size", [(600, (480, 80)), (64, (64, 100))])
def test_a_gif_is_small_endless_and_as_fast_as_the_video(tmp_path, width, size):
    frames = np.zeros((40, 100, width, 3), np.uint8)
    frames[20:, :, : width // 2] = 255
    write_video(frames, tmp_path / "video.mp4", 20)
    gif = PIL.Image.open(io.BytesIO(as_gif(tmp_path / "video.mp4")))
    # 40 frames at 20 a second are 2 seconds: 20 frames of 100 ms.
    assert (gif.size, gif.n_frames, gif.info["duration"], gif.info["loop"]) == (size, 20, 100, 0)
    for frame, left in ((0, 0), (19, 255)):
        gif.seek(frame)
        shown = np.asarray(gif.convert("L"), int)
        assert abs(shown[:, :20] - left).max() < 20 and shown[:, -20:].max() < 20


def test_what_is_no_video_is_refused_by_its_name(tmp_path):
    (tmp_path / "words.mp4").write_text("words")
    with pytest.raises(ValueError, match="words.mp4 cannot be read as a video: ") as refused:
        as_gif(tmp_path / "words.mp4")
    assert "\n" not in str(refused.value)
