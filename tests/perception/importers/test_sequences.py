"""The number that runs through the names is the frame's, and one recording is neither split nor merged."""

import random
from fractions import Fraction
from pathlib import Path, PurePath

import pytest

from graphrl_jax.perception.importers.recording import ImportFailure
from graphrl_jax.perception.importers.sequences import Frame, sequence_of, sequences

IN_ORDER = {
    "plain": ["1.png", "2.png", "10.png"],
    "padded and not": ["frame_01.png", "frame_2.png", "frame_010.png"],
    "in brackets": ["frame (1).png", "frame (2).png", "frame (10).png"],
    "of a total": ["img_1_of_10.png", "img_2_of_10.png", "img_10_of_10.png"],
    "before a size": ["1_640x480.png", "2_640x480.png", "10_640x480.png"],
    "before sizes of their own": ["frame_1_w64.png", "frame_2_w31.png", "frame_3_w50.png"],
    "endings in capitals": ["1.png", "2.PNG", "3.Png"],
    "words in capitals": ["Frame_1.png", "frame-2.png", "FRAME3.png"],
    "below zero": ["-2.png", "-1.png", "0.png", "1.png"],
    "after a minus that separates": ["take_-1.png", "take_-2.png", "take_-3.png"],
    "prefixes of Label Studio": ["e51b2c07-frame_1.png", "09d4aa31-frame_2.png", "7c3f9e12-frame_10.png"],
    "prefixes that look like numbers or words": ["12345678-a_1.png", "09d4aa31-a_2.png", "deadbeef-a_3.png"],
    "identifiers": [f"{one}-4a1b-4c2d-8e3f-0123456789ab_{n}.png" for n, one in enumerate(("f1e2d3c4", "0a1b2c3d"))],
    "suffixes of Roboflow": [f"f_{n}_jpg.rf.{one}.jpg" for n, one in enumerate(("9f8e7d6c5b4a", "1a2b3c4d5e6f"))],
    "random numbers before": ["83920183_0001.png", "12938102_0002.png", "55500000_0003.png"],
    "random numbers after": ["0001_83920183.png", "0002_12938102.png", "0003_55500000.png"],
    "dates beside": ["0001_20240103.png", "0002_20240101.png", "0003_20240102.png"],
    "beside counts that vary": ["0001_3objects.png", "0002_2objects.png", "0003_3objects.png"],
    "words in hexadecimal letters": ["face0001.png", "face0002.png", "face0010.png"],
    "hexadecimal": ["frame_08.png", "frame_09.png", "frame_0a.png", "frame_0b.png", "frame_0c.png"],
    "decimal times": ["12.0625.png", "12.125.png", "12.25.png", "12.5.png"],
    "decimal times over whole seconds": ["t=0.5.png", "t=1.0.png", "t=1.5.png", "t=2.0.png", "t=2.5.png"],
    "decimal times and whole ones": ["1.5.png", "2.png", "2.25.png", "3.png"],
    "tenths of seconds": [f"{tenths / 10:.1f}.png" for tenths in range(5, 25)],
    "numbers after a dot": ["1.8.png", "1.9.png", "1.10.png", "1.11.png"],
    "a recording's number before a dot": ["shot.1.0001.png", "shot.1.0002.png", "shot.1.0010.png"],
    "dates with milliseconds": ["20240101_101500_623.png", "20240101_101500_823.png", "20240101_101501_023.png"],
    "dates at uneven times": ["20240101_101500_123.png", "20240101_101501_101.png", "20240101_101509_022.png"],
    "dates over midnight": ["2024-01-31 23-59-59.png", "2024-02-01 00-00-00.png", "2024-02-01 00-00-01.png"],
    "dates of cameras": ["IMG_20240101_101559.jpg", "IMG_20240101_101600.jpg", "IMG_20240101_101601.jpg"],
    "clock times": ["09-59-58.png", "09-59-59.png", "10-00-00.png", "10-00-01.png"],
    "milliseconds since an epoch": ["1704100500123.png", "1704100500248.png", "1704100501001.png"],
    "dates before a number": ["20240102_frame_1.png", "20240101_frame_2.png", "20240103_frame_3.png"],
    "a number and a time": ["0001_t0.033.png", "0002_t0.067.png", "0003_t0.100.png"],
    "a number and a confidence": ["0001_0.98.png", "0002_0.87.png", "0003_0.91.png"],
    "no number at all in one file": ["start.png"],
}


def names_of(found):
    return [[path.name for path in sequence.paths] for sequence in found]


@pytest.mark.parametrize("names", IN_ORDER.values(), ids=IN_ORDER)
def test_the_number_that_runs_is_the_frames(names):
    for seed in range(3):
        shuffled = random.Random(seed).sample(names, len(names))
        assert names_of(sequences([PurePath("take_7/2024", name) for name in shuffled])) == [names]


RECORDINGS = {
    "words differ": [["pick_a_1", "pick_a_2", "pick_a_4"], ["pick_b_1", "pick_b_2", "pick_b_3"]],
    "numbers differ": [["take1_1", "take1_2", "take1_3"], ["take2_1", "take2_2"]],
    "many short ones": [[f"run{run}_{frame}" for frame in (1, 2, 3)] for run in range(1, 7)],
    "numbers after the frame's": [[f"frame_{n:03d}_cam{cam}" for n in range(5)] for cam in (1, 2)],
    "starts of recordings": [[f"20240101_{start}_{n:04d}" for n in (1, 2, 3)] for start in (101500, 101730)],
    "days": [[f"2024-01-0{day}_frame_{n}" for n in (1, 2, 3)] for day in (1, 2)],
    "shots before a dot": [[f"{shot}.{n:04d}" for n in (1, 2, 3)] for shot in (1, 2)],
    "hashes of recordings": [[f"{one}_{n}" for n in (1, 2)] for one in ("7c3f9e12b5", "09d4aa31c2")],
    "far apart": [["pick_a_10", "pick_a_11"], ["pick_b_100", "pick_b_101"]],
    "every tenth frame": [[f"v{v}_{n}" for n in (0, 10, 20)] for v in (1, 2)],
}


@pytest.mark.parametrize("recordings", RECORDINGS.values(), ids=RECORDINGS)
def test_numbers_that_restart_are_several_recordings(recordings):
    paths = [PurePath(f"{name}.txt") for recording in recordings for name in recording]
    found = sequences(random.Random(0).sample(paths, len(paths)))
    assert [[path.stem for path in sequence.paths] for sequence in found] == recordings
    assert found[1].source(Path("labels"), found) == Path("labels", f"{recordings[1][0]}.txt")
    assert found[1].source(Path("labels"), found[:1]) == Path("labels")


REFUSED = {
    "no number": (["start", "end"], "start.txt: the name holds no frame number"),
    "no number in one": (["frame", "frame (1)", "frame (2)"], "frame.txt: the name holds no frame number"),
    "a repeat": (["1", "01", "2"], "1.txt and 01.txt: both are frame 1"),
    "a repeat in other words": (["frame_1", "Frame 1", "frame_2"], "both are frame 1"),
    "a repeat with other hashes": (
        ["e51b2c07-frame_1", "09d4aa31-frame_1", "7c3f9e12-frame_2"],
        "e51b2c07-frame_1.txt and 09d4aa31-frame_1.txt: both are frame 1",
    ),
    "a lone start": (["take1_1", "take1_2", "take2_1"], "take1_1.txt and take2_1.txt: both are frame 1"),
    "a copy": (["frame_1", "frame_2", "frame_2 - copy"], "frame_2 - copy.txt: no other file"),
    "a step back": (["1_1", "2_2", "3_5", "4_4"], "4_4.txt and 3_5.txt: a number steps back from 4 to 3"),
    "mixed words": (["img_1", "frame_2", "img_3", "frame_4"], "img_1.txt and frame_2.txt: the names differ"),
    "words that follow on": (["reach_1", "reach_2", "grasp_3", "grasp_4"], "reach_2.txt and grasp_3.txt"),
    "numbers that follow on": (["cam1_1", "cam1_2", "cam2_3", "cam2_4"], "cam1_2.txt and cam2_3.txt"),
    "hashes alone": (["e51b2c07", "09d4aa31"], "the name holds no frame number"),
}


@pytest.mark.parametrize("names, message", REFUSED.values(), ids=REFUSED)
def test_what_is_unclear_is_refused_by_name(names, message):
    with pytest.raises(ImportFailure) as failure:
        sequences([PurePath(f"{name}.txt") for name in names])
    assert message in str(failure.value)


@pytest.mark.parametrize(
    "names, present",
    [
        (["1", "2", "9"], "110000001"),
        (["0", "2", "5"], "101001"),
        (["0", "10", "20", "50"], "111001"),
        (["0.1", "0.2", "0.4"], "1101"),
        (["12.0625", "12.125", "12.25", "12.5"], "11010001"),
        (["t0.033", "t0.067", "t0.134"], "1101"),
        (["20240101_101500_123", "20240101_101501_125", "20240101_101504_119"], "11001"),
        (["7"], "1"),
    ],
)
def test_numbers_that_are_skipped_are_frames(names, present):
    (sequence,) = sequences([PurePath(f"{name}.txt") for name in names])
    frames, _ = sequence.with_gaps()
    assert "".join(str(int(frame is not None)) for frame in frames) == present
    assert [frame.stem for frame in frames if frame is not None] == names


def test_notes_tell_of_steps_and_gaps():
    (sequence,) = sequences([PurePath(f"{n}.txt") for n in (0, 10, 30)])
    assert sequence.with_gaps()[1] == (
        "step between numbers: 10",
        "numbers skipped, as frames in which nothing was seen: 1",
    )


def test_frames_whose_numbers_are_known_are_sorted_and_do_not_repeat():
    frames = [Frame(PurePath(name), Fraction(number)) for name, number in (("a", 3), ("b", 1))]
    assert sequence_of(frames).paths == [PurePath("b"), PurePath("a")]
    with pytest.raises(ImportFailure, match="a and c: both are frame 3"):
        sequence_of([*frames, Frame(PurePath("c"), Fraction(3))])
