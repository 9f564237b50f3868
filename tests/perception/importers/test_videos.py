"""A video's frames last as long as the video, stand upright, and a video that breaks off is refused."""

import subprocess

import imageio.v3 as imageio
import numpy as np
import pytest
from imageio_ffmpeg import get_ffmpeg_exe

from graphrl_jax.demonstrations import load
from graphrl_jax.perception.importers.recording import ImportFailure
from graphrl_jax.perception.importers.videos import read_videos
from graphrl_jax.viz.video import write_video
from tests.helpers.importing import FRAMES, refused, run

PATTERN = ["-f", "lavfi", "-i", "testsrc=size=48x32:rate=8:duration=2"]
SOUND = ["-f", "lavfi", "-i", "sine=duration=4"]


def ffmpeg(*arguments):
    subprocess.run([get_ffmpeg_exe(), "-y", "-v", "error", "-nostdin", *map(str, arguments)], check=True)


def only(path):
    (recording,) = read_videos([path])
    return recording


def test_a_video_holds_what_its_frames_hold(tmp_path):
    write_video(FRAMES, tmp_path / "demo.mp4", 8.0)
    imageio.imwrite(tmp_path / "demo.gif", FRAMES, duration=125)
    for name in ("demo.mp4", "demo.gif"):
        recording = only(tmp_path / name)
        assert recording.frames.shape == FRAMES.shape
        assert np.abs(recording.frames.astype(int) - FRAMES).mean() < 3
        assert recording.frame_rate == pytest.approx(8.0, rel=0.05)  # a gif counts in hundredths


@pytest.mark.parametrize("ending", ["mp4", "mov", "mkv", "webm", "avi", "gif"])
def test_every_container_keeps_the_duration(tmp_path, ending):
    ffmpeg(*PATTERN, tmp_path / f"take.{ending}")
    recording = only(tmp_path / f"take.{ending}")
    assert (recording.frames.shape, recording.frame_rate, recording.notes) == ((16, 32, 48, 3), 8.0, ())


@pytest.mark.parametrize("ending", ["mp4", "mkv", "gif"])
@pytest.mark.parametrize("kept", ["not(between(n,3,8))", "lt(n,8)+not(mod(n,4))"])
def test_a_varying_rate_is_made_constant(tmp_path, ending, kept):
    path = tmp_path / f"take.{ending}"
    ffmpeg(*PATTERN, "-vf", f"select='{kept}'", "-fps_mode", "passthrough", path)
    recording = only(path)
    assert len(recording.frames) / recording.frame_rate == pytest.approx(2.0, abs=0.4 if "mod" in kept else 0.05)
    assert recording.frame_rate == pytest.approx(8.0, rel=0.05) and "of a varying rate" in recording.notes[0]
    assert (recording.frames[3] == recording.frames[2]).all() == ("between" in kept)


def test_a_video_is_upright(tmp_path):
    ffmpeg(*PATTERN, tmp_path / "flat.mp4")
    ffmpeg("-display_rotation", 90, "-i", tmp_path / "flat.mp4", "-c", "copy", tmp_path / "turned.mp4")
    flat, turned = only(tmp_path / "flat.mp4").frames, only(tmp_path / "turned.mp4").frames
    assert np.abs(np.rot90(flat, axes=(1, 2)).astype(int) - turned).mean() < 3


@pytest.mark.parametrize("ending", ["mp4", "webm"])
def test_sound_may_outlast_the_images(tmp_path, ending):
    ffmpeg(*PATTERN, *SOUND, tmp_path / f"take.{ending}")
    recording = only(tmp_path / f"take.{ending}")
    assert (len(recording.frames), recording.frame_rate) == (16, 8.0)


@pytest.mark.parametrize("sound", [[], SOUND])
@pytest.mark.parametrize("ending", ["mp4", "mkv", "webm", "avi", "gif"])
def test_a_video_that_breaks_off_is_refused(tmp_path, ending, sound):
    path = tmp_path / f"take.{ending}"
    ffmpeg(
        *PATTERN, *(sound if ending != "gif" else []), *(["-movflags", "faststart"] if ending == "mp4" else []), path
    )
    whole = path.read_bytes()
    for share in (0.5, 0.8):
        path.write_bytes(whole[: int(share * len(whole))])
        with pytest.raises(ImportFailure, match=f"take.{ending}: (the video breaks off|no video that can be read)"):
            only(path)


def test_videos_are_resampled_to_the_rate_that_is_asked_for(tmp_path, capsys):
    for rate, name in ((8.0, "a"), (16.0, "b")):
        write_video(np.repeat(FRAMES, int(rate / 4), axis=0), tmp_path / f"{name}.mp4", rate)
    assert "the videos have [8.0, 16.0] frames per second" in refused(capsys, tmp_path)
    run(tmp_path, "--out", tmp_path / "demos.npz", "--frame-rate", 8)
    demos = load(tmp_path / "demos.npz")
    assert demos.frame_rate == 8.0
    np.testing.assert_array_equal(demos.lengths, [8, 8])
    assert "b.mp4: 8 frames; resampled from 16 to 8 frames per second" in " ".join(capsys.readouterr().err.split())


def test_rates_that_differ_by_rounding_are_one(tmp_path):
    write_video(FRAMES, tmp_path / "a.mp4", 30.0)
    write_video(FRAMES, tmp_path / "b.mp4", 30000 / 1001)
    run(tmp_path, "--out", tmp_path / "demos.npz")
    assert load(tmp_path / "demos.npz").frame_rate == pytest.approx(30000 / 1001)
