"""Clips of a file are its own frames, whatever the codec; a file that lacks some is refused."""

from pathlib import Path

import numpy as np
import pytest

from graphrl_jax.perception.importers.clips import (
    Clip,
    frame_times,
    read_clips,
    refuse_other_times,
    refuse_overlaps,
    video_frames,
)
from graphrl_jax.perception.importers.recording import ImportFailure
from tests.helpers.robot_datasets import SIZE, are_pictures, pictures, write_mp4


def clips_of(clips, size=SIZE):
    return list(read_clips(clips, size, video_frames, lambda frame, _: frame))


@pytest.mark.parametrize("codec", ["libx264", "libaom-av1", "libvpx-vp9"])
def test_clips_hold_their_own_frames(tmp_path, codec):
    for name in ("a", "b"):
        write_mp4(tmp_path / f"{name}.mp4", np.concatenate([pictures(index, 4) for index in range(3)]), codec)
    spans = [("a", 0, 4), ("a", 8, 12), ("b", 4, 8), ("a", 0, 4)]
    found = clips_of([Clip(tmp_path / f"{name}.mp4", start, stop) for name, start, stop in spans])
    for frames, episode in zip(found, (0, 2, 1, 0), strict=True):
        assert are_pictures(frames, episode, 4)


def test_only_what_a_clip_needs_is_decoded(tmp_path):
    decoded = []

    def decode(raw, where):
        decoded.append(where)
        return np.full((1, 1, 3), raw, np.uint8)

    clips = [Clip(tmp_path, 2, 4), Clip(tmp_path, 7, 8)]
    frames = list(read_clips(clips, (1, 1), lambda _: iter(range(100)), decode))
    assert [one.ravel()[::3].tolist() for one in frames] == [[2, 3], [7]]
    assert decoded == [f"{tmp_path}: frame {number}" for number in (2, 3, 7)]


def test_frames_that_are_missing_or_of_another_size_are_refused(tmp_path):
    path = tmp_path / "take.mp4"
    write_mp4(path, pictures(0, 4))
    for clip in (Clip(path, 2, 5), Clip(path, 8, 9)):
        with pytest.raises(ImportFailure, match=f"the frames break off after 4; allowed: {clip.stop} or more"):
            clips_of([clip])
    with pytest.raises(ImportFailure, match="frame 1 is 64 x 48; allowed: 32 x 48"):
        clips_of([Clip(path, 1, 3)], (48, 32))


def test_clips_that_share_frames_are_refused():
    one, other = Path("one.mp4"), Path("other.mp4")
    refuse_overlaps([Clip(one, 0, 4), Clip(other, 0, 4), Clip(one, 4, 6), Clip(one, 8, 9)])
    for start in (0, 3):
        with pytest.raises(ImportFailure, match=f"begins at frame {start}, but the one before ends with frame 3"):
            refuse_overlaps([Clip(one, 0, 4), Clip(other, 0, 4), Clip(one, start, 6)])


@pytest.mark.parametrize("codec", ["libx264", "libaom-av1"])
def test_times_are_those_of_the_frames(tmp_path, codec):
    write_mp4(tmp_path / "take.mp4", pictures(0, 5), codec)
    np.testing.assert_allclose(frame_times(tmp_path / "take.mp4"), np.arange(5) / 10, atol=1e-4)
    assert refuse_other_times(tmp_path / "take.mp4", 10, 4) == 5
    with pytest.raises(ImportFailure, match="it has 5 frames; allowed: 6 or more"):
        refuse_other_times(tmp_path / "take.mp4", 10, 6)
    for rate, number in ((30, 1), (12, 3)):
        with pytest.raises(ImportFailure, match=f"frame {number} is shown at 0.{number} s; allowed: "):
            refuse_other_times(tmp_path / "take.mp4", rate, 4)


@pytest.mark.parametrize("share", [0.3, 0.6, 0.9])
def test_a_video_that_breaks_off_is_refused(tmp_path, share):
    path = tmp_path / "take.mp4"
    noise = np.random.default_rng(0).integers(0, 255, (20, *SIZE, 3), np.uint8)
    write_mp4(path, noise)
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
    with pytest.raises(ImportFailure, match="take.mp4: (it has|the frames break off|no video)"):
        refuse_other_times(path, 10, 20)
        clips_of([Clip(path, 0, 20)])


def test_what_is_no_video_is_refused(tmp_path):
    (tmp_path / "take.mp4").write_bytes(b"no video")
    for read in (frame_times, lambda path: clips_of([Clip(path, 0, 1)])):
        with pytest.raises(ImportFailure, match="take.mp4: no video that can be read"):
            read(tmp_path / "take.mp4")
    with pytest.raises(ImportFailure, match="gone.mp4 is missing"):
        frame_times(tmp_path / "gone.mp4")
