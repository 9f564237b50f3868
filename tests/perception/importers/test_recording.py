"""Files and folders come in order of the numbers in their names, texts are UTF-8, recordings keep their duration."""

from pathlib import Path

import numpy as np
import pytest

from graphrl_jax.perception.detector import Detection
from graphrl_jax.perception.importers.recording import (
    ImportFailure,
    Recording,
    files_of,
    folders_of,
    frames_shown,
    in_order,
    raw_text,
    read_text,
    resampled,
    resampled_frames,
)


def test_numbers_count_as_numbers():
    names = ["run10/2.png", "run2/10.png", "run2/9.png", "a.png"]
    ordered = ["a.png", "run2/9.png", "run2/10.png", "run10/2.png"]
    assert in_order(map(Path, names)) == [Path(name) for name in ordered]
    folders = folders_of([Path(name) for name in ordered])
    assert list(folders) == [Path("."), Path("run2"), Path("run10")]
    assert folders[Path("run2")] == [Path("run2/9.png"), Path("run2/10.png")]


def test_files_are_found_at_any_depth_by_their_endings(tmp_path):
    (tmp_path / "deep" / "er").mkdir(parents=True)
    for name in ("2.PNG", "deep/1.png", "deep/er/10.jpg", "notes.txt"):
        (tmp_path / name).touch()
    found = files_of(tmp_path, ".png", ".jpg")
    assert found == [tmp_path / "2.PNG", tmp_path / "deep/1.png", tmp_path / "deep/er/10.jpg"]
    assert files_of(tmp_path / "2.PNG", ".png") == [tmp_path / "2.PNG"]
    assert files_of(tmp_path / "notes.txt", ".png") == []


def test_hidden_and_system_files_are_left_out(tmp_path):
    names = ["a/1.png", ".cache/2.png", "__MACOSX/a/._1.png", "a/._1.png", "@eaDir/3.png", "a/.ipynb_checkpoints/4.png"]
    for name in names:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    assert files_of(tmp_path, ".png") == [tmp_path / "a/1.png"]
    assert files_of(tmp_path / ".cache", ".png") == [tmp_path / ".cache/2.png"]  # it was asked for


def test_links_are_followed_once(tmp_path):
    (tmp_path / "far").mkdir()
    (tmp_path / "far" / "1.png").touch()
    (tmp_path / "in").mkdir()
    for name, target in (("a", "../far"), ("b", "../far"), ("loop", "."), ("up", "../in"), ("2.png", "../far/1.png")):
        (tmp_path / "in" / name).symlink_to(target)
    assert files_of(tmp_path / "in", ".png") == [tmp_path / "in/2.png", tmp_path / "in/a/1.png"]


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_a_text_has_no_byte_order_mark(tmp_path, encoding):
    (tmp_path / "a.txt").write_text("größe", encoding)
    assert read_text(tmp_path / "a.txt") == "größe"


def test_what_is_no_text_is_said(tmp_path):
    (tmp_path / "a.txt").write_bytes(b"gr\xf6\xdfe")
    with pytest.raises(ImportFailure, match="a.txt: no text in UTF-8: invalid start byte at byte 2"):
        read_text(tmp_path / "a.txt")
    (tmp_path / "b.txt").symlink_to("nowhere")
    with pytest.raises(ImportFailure, match="b.txt: cannot be read: No such file"):
        read_text(tmp_path / "b.txt")


@pytest.mark.parametrize(
    "rate, shown", [(4, [0, 2, 4]), (8, list(range(6))), (16, [0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 5, 5])]
)
def test_a_resampled_recording_keeps_its_duration(tmp_path, rate, shown):
    frames = np.arange(6, dtype=np.uint8).reshape(6, 1, 1, 1) * np.ones((1, 1, 3), np.uint8)
    recording = resampled(Recording(tmp_path, frames, frame_rate=8.0, notes=("cut",)), rate)
    np.testing.assert_array_equal(recording.frames[:, 0, 0, 0], shown)
    assert recording.frame_rate == rate and len(recording.notes) == 1 + (rate != 8)
    found = [[Detection(number, np.zeros(4, np.float32))] for number in range(6)]
    recording = resampled(Recording(tmp_path, detections=found, frame_rate=8.0), rate)
    assert [frame[0].class_id for frame in recording.detections] == list(shown) and recording.frame_rate == rate


def test_the_frames_that_are_shown_are_known_by_their_numbers():
    np.testing.assert_array_equal(resampled_frames(6, 8.0, 4.0), [0, 2, 4])
    np.testing.assert_array_equal(resampled_frames(3, 4.0, 8.0), [0, 0, 1, 1, 2, 2])
    for rates in ((None, 8.0), (8.0, None), (29.97, 30.0)):
        assert resampled_frames(6, *rates) is None


def test_without_rates_nothing_is_resampled(tmp_path):
    for recording, rate in (
        (Recording(tmp_path, np.zeros((2, 1, 1, 3), np.uint8)), 4.0),
        (Recording(tmp_path, np.zeros((2, 1, 1, 3), np.uint8), frame_rate=8.0), None),
        (Recording(tmp_path, np.zeros((2, 1, 1, 3), np.uint8), frame_rate=29.97), 30.0),
        (Recording(tmp_path, detections=[[]]), 4.0),
    ):
        assert resampled(recording, rate) is recording


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_a_look_at_a_text_needs_no_encoding(tmp_path, encoding):
    path = tmp_path / "a.json"
    path.write_text('\n\t[{"größe": 1}]', encoding)
    assert raw_text(path)[:3] == b'[{"'


def test_a_frame_is_shown_until_the_next_begins():
    times = np.array([0.0, 0.125, 0.25, 1.0, 1.125])
    np.testing.assert_array_equal(frames_shown(times, 1.25, 8.0), [0, 1, 2, 2, 2, 2, 2, 2, 3, 4])
    np.testing.assert_array_equal(frames_shown(np.zeros(1), 0.01, 8.0), [0])


@pytest.mark.parametrize("rate, expected", [(4.0, {"a": 0, "b": 2, "c": 3}), (16.0, {"a": 0, "b": 6, "c": 14})])
def test_events_stay_at_their_time(rate, expected):
    recording = Recording(Path("a"), np.zeros((8, 1, 1, 3), np.uint8), frame_rate=8.0, events={"a": 0, "b": 3, "c": 7})
    assert resampled(recording, rate).events == expected
    assert resampled(recording, 8.0).events == recording.events


def test_a_recording_of_endless_frames_is_refused():
    with pytest.raises(
        ImportFailure, match=r"1e\+06 s are 8e\+06 frames at 8 per second; allowed: up to 500000 frames"
    ):
        frames_shown(np.array([0.0, 1.0]), 1e6, 8.0)
