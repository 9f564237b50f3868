"""Videos and folders of frames are read in order; what is wrong with them is one sentence, and nothing is written."""

import gc

import imageio.v3 as imageio
import numpy as np
import pytest

from graphrl_jax.demonstrations import load
from graphrl_jax.perception.importers.convert import Source
from graphrl_jax.viz.video import write_video
from tasks.match_regions.objects import OBJECTS
from tests.helpers.importing import FRAMES, refused, run


def test_frames_are_read_in_order_of_their_numbers(tmp_path):
    for number, frame in zip((0, 1, 2, 10), FRAMES, strict=True):
        imageio.imwrite(tmp_path / f"{number}.png", frame)
    run(tmp_path, "--out", tmp_path / "demos.npz")
    star = load(tmp_path / "demos.npz").boxes[0, :, OBJECTS.names.index("star"), 0]
    assert np.all(np.diff(star) < 0)


def test_a_video_says_nearly_what_its_frames_say(tmp_path):
    write_video(FRAMES, tmp_path / "demo.mp4", 8.0)
    imageio.imwrite(tmp_path / "demo.gif", FRAMES, duration=125)
    for name in ("demo.mp4", "demo.gif"):
        (recording,) = Source(tmp_path / name).recordings(OBJECTS)
        assert recording.frames is not None and recording.frames.shape == FRAMES.shape
        assert np.abs(recording.frames.astype(int) - FRAMES).mean() < 3
        assert recording.frame_rate == pytest.approx(8.0, rel=0.05)  # a gif counts in hundredths


def test_what_is_wrong_with_images_is_said(tmp_path, capsys):
    folder = tmp_path / "demo"
    folder.mkdir()
    imageio.imwrite(folder / "0.png", FRAMES[0])
    imageio.imwrite(folder / "1.png", FRAMES[1][:100])
    assert "1.png: the frame is 384 x 100, but the folder's first one 384 x 384" in refused(capsys, folder)
    (folder / "1.png").write_bytes(b"no image")
    assert "1.png: no image that can be read" in refused(capsys, folder)
    (tmp_path / "demo.mp4").write_bytes(b"")
    assert "demo.mp4: no video that can be read" in refused(capsys, tmp_path / "demo.mp4")
    assert "is missing" in refused(capsys, tmp_path / "nowhere")
    assert "--frame-rate is 0.0; allowed: numbers above 0" in refused(capsys, folder, "--frame-rate", 0)
    (tmp_path / "empty").mkdir()
    assert "holds nothing of a known format" in refused(capsys, tmp_path / "empty")
    assert "holds no demonstrations" in refused(capsys, tmp_path / "empty", "--format", "video")
    assert "unknown format 'avi'" in refused(capsys, folder, "--format", "avi")
    imageio.imwrite(folder / "1.png", FRAMES[1])
    assert "images need a detector" in refused(capsys, folder, "--task", "shoes_in_box")
    gc.collect()  # while its warnings are ignored
