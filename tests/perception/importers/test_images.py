"""Folders of frames are read in order; what is wrong with them is one sentence, and nothing is written."""

import gc

import imageio.v3 as imageio
import numpy as np
import pytest
from PIL import Image

from graphrl_jax.demonstrations import load
from graphrl_jax.perception.importers.convert import Source
from tasks.match_regions.objects import OBJECTS
from tests.helpers.importing import FRAMES, refused, run


def test_frames_are_read_in_order_of_their_numbers(tmp_path):
    for number, frame in zip((0, 1, 2, 10), FRAMES, strict=True):
        imageio.imwrite(tmp_path / f"{number}.png", frame)
    run(tmp_path, "--out", tmp_path / "demos.npz")
    star = load(tmp_path / "demos.npz").boxes[0, :, OBJECTS.names.index("star"), 0]
    assert np.all(np.diff(star) < 0)


@pytest.mark.parametrize("orientation, turns", [(3, 2), (6, 1), (8, 3)])
@pytest.mark.parametrize("ending", ["jpg", "png"])
def test_images_are_upright(tmp_path, orientation, turns, ending):
    """Orientation 6 says that the image has to be turned clockwise by a quarter to stand upright, 8 the opposite."""
    exif = Image.Exif()
    exif[0x0112] = orientation
    for number, frame in enumerate(FRAMES):
        Image.fromarray(np.rot90(frame, turns)).save(tmp_path / f"{number}.{ending}", exif=exif, quality=95)
    (recording,) = Source(tmp_path).recordings(OBJECTS)
    assert np.abs(recording.frames.astype(int) - FRAMES).mean() < 3


@pytest.mark.parametrize("mode", ["L", "P", "RGBA", "CMYK"])
def test_images_of_8_bits_are_converted(tmp_path, mode):
    grey = Image.fromarray(np.full((4, 6, 3), 128, np.uint8))
    (grey.quantize(4) if mode == "P" else grey.convert(mode)).save(tmp_path / ("0.jpg" if mode == "CMYK" else "0.png"))
    (recording,) = Source(tmp_path).recordings(OBJECTS)
    assert recording.frames.shape == (1, 4, 6, 3) and np.abs(recording.frames.astype(int) - 128).max() < 3


def test_hidden_folders_are_left_out_and_links_followed(tmp_path):
    for folder in ("in/take1", "in/take1/.ipynb_checkpoints", "in/__MACOSX", "far"):
        (tmp_path / folder).mkdir(parents=True)
        for number in range(2):
            imageio.imwrite(tmp_path / folder / f"{number}.png", FRAMES[number])
    (tmp_path / "in" / "take2").symlink_to("../far")
    (tmp_path / "in" / "take1" / "again").symlink_to("..")
    run(tmp_path / "in", "--out", tmp_path / "demos.npz")
    np.testing.assert_array_equal(load(tmp_path / "demos.npz").lengths, [2, 2])


def test_what_is_wrong_with_images_is_said(tmp_path, capsys):
    folder = tmp_path / "demo"
    folder.mkdir()
    imageio.imwrite(folder / "0.png", FRAMES[0])
    imageio.imwrite(folder / "1.png", FRAMES[1][:100])
    assert "1.png: the frame is 384 x 100, but the recording's first one 384 x 384" in refused(capsys, folder)
    (folder / "1.png").write_bytes(b"no image")
    assert "1.png: no image that can be read" in refused(capsys, folder)
    (tmp_path / "demo.mp4").write_bytes(b"")
    assert "demo.mp4: no video that can be read" in refused(capsys, tmp_path / "demo.mp4")
    (folder / "1.png").write_bytes((folder / "0.png").read_bytes()[:300])
    assert "1.png: no image that can be read" in refused(capsys, folder)
    Image.fromarray(np.zeros((384, 384), np.uint16)).save(folder / "1.png")
    assert "1.png: the pixels are of Pillow's mode I;16; allowed: 8 bits" in refused(capsys, folder)
    (folder / "1.png").unlink()
    (folder / "1.png").symlink_to("nowhere.png")
    assert "1.png: no image that can be read" in refused(capsys, folder)
    (folder / "1.png").unlink()
    assert "is missing" in refused(capsys, tmp_path / "nowhere")
    assert "--frame-rate is 0.0; allowed: numbers above 0" in refused(capsys, folder, "--frame-rate", 0)
    (tmp_path / "empty").mkdir()
    assert "empty is empty; allowed: a folder with recordings" in refused(capsys, tmp_path / "empty")
    assert "holds no demonstrations" in refused(capsys, tmp_path / "empty", "--format", "video")
    assert "unknown format 'avi'" in refused(capsys, folder, "--format", "avi")
    imageio.imwrite(folder / "1.png", FRAMES[1])
    message = refused(capsys, folder, "--task", "shoes_in_box")
    assert "task shoes_in_box has no detector for its objects" in message and "allowed: --weights MODEL" in message
    gc.collect()  # while its warnings are ignored
