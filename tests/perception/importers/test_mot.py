"""Text of the MOT challenge comes through to the pixel, and what is wrong with a line is one sentence."""

import numpy as np
import pytest

from graphrl_jax.demonstrations import load
from graphrl_jax.perception.importers.mot import mot_files, read_mot
from graphrl_jax.perception.importers.recording import ImportFailure
from tasks.match_regions.objects import OBJECTS
from tests.helpers.importing import refused, run

SQUARE = OBJECTS.class_names.index("green_square")
SEQUENCE = "[Sequence]\nname=pick\nimDir=img1\nframeRate=30\nseqLength=4\nimWidth=100\nimHeight=200\nimExt=.jpg\n"
LINE = "2,1,11,21,20,40,1,4,1"
"""A green square, class 4, in frame 2. Pixels count from 1: in 100 x 200 pixels a box of (0.2, 0.2, 0.2, 0.2)."""


@pytest.fixture
def read(tmp_path):
    """The recording of a file in a sequence: class, box and confidence of the detections in each frame."""

    def read(text, name="gt/gt.txt", told=SEQUENCE, labels=None, size=None, class_names=OBJECTS.class_names):
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)
        if told is not None:
            (tmp_path / "seqinfo.ini").write_text(told)
        if labels is not None:
            (path.parent / "labels.txt").write_text(labels)
        (recording,) = read_mot([path], tmp_path, class_names, size)
        frames = [
            [(one.class_id, [round(float(value), 4) for value in one.box], one.confidence) for one in frame]
            for frame in recording.detections
        ]
        return frames, recording.frame_rate

    return read


BOX = (SQUARE, [0.2, 0.2, 0.2, 0.2], 1.0)


@pytest.mark.parametrize(
    "line", [LINE, LINE.replace(",", ", "), f"\n{LINE}\r\n\r\n", LINE.replace("20,40", "20.0,4e1")]
)
def test_a_line_is_a_box(read, line):
    assert read(line) == ([[], [BOX], [], []], 30.0)
    assert read(line, told=None, size=(100, 200)) == ([[], [BOX], [], []], 30.0)


def test_without_seqinfo_the_size_is_the_users_and_the_last_frame_a_lines(read):
    assert read(LINE, told=None, size=(100, 200)) == ([[], [BOX]], None)


def test_import_of_a_sequence(tmp_path, capsys):
    sequence = tmp_path / "MOT16-02"
    for name, text in {
        "gt/gt.txt": "3,1,31,21,20,40,1,4,1\n1,1,11,21,20,40,1,4,1\n2,1,1,1,99,99,0,8,1\n",
        "det/det.txt": "1,-1,11,21,20,40,67.5,-1,-1,-1\n",
        "seqinfo.ini": SEQUENCE,
        "img1/000001.jpg": "",
    }.items():
        (sequence / name).parent.mkdir(parents=True, exist_ok=True)
        (sequence / name).write_text(text)
    run(tmp_path, "--out", tmp_path / "demos.npz")
    demos = load(tmp_path / "demos.npz")
    slot = OBJECTS.names.index("square")
    np.testing.assert_array_equal(demos.lengths, [4])
    assert demos.frame_rate == 30
    np.testing.assert_allclose(demos.boxes[0, :, slot, 0], [0.2, 0.3, 0.4, 0.0], rtol=1e-6)
    assert "det.txt, line 1: column 7 is 67.5; allowed: a confidence from 0 to 1" in refused(capsys, sequence / "det")
    run(tmp_path, "--out", tmp_path / "slow.npz", "--frame-rate", 15)
    np.testing.assert_allclose(load(tmp_path / "slow.npz").boxes[0, :, slot, 0], [0.2, 0.4], rtol=1e-6)


def test_class_names_beside_the_file_decide_and_pixels_count_from_0_there(read):
    """So CVAT writes it."""
    frames, _ = read("1,1,10,20,20,40,1,2,1", labels="robot\ngreen_square\n")
    assert frames[0] == [BOX]
    for number, says in ((1, "class 1 is 'cat' by .*labels.txt; allowed: goal_region"), (3, "class 3; allowed: 1, 2")):
        with pytest.raises(ImportFailure, match=f"gt.txt, line 1: {says}"):
            read(f"1,1,10,20,20,40,1,{number},1", labels="cat\ngreen_square\n")


def test_lines_without_a_class_are_of_the_only_one(read):
    line = "1,1,11,21,20,40,0.5,-1,-1,-1"
    assert read(line, "det/det.txt", class_names=("block",))[0][0] == [(0, BOX[1], 0.5)]
    assert read(line[:18], "tracked.txt", labels="green_square")[0][0][0][0] == SQUARE
    with pytest.raises(
        ImportFailure, match="tracked.txt, line 1: says no class; allowed: a class in column 8 of 9, or"
    ):
        read(line, "tracked.txt", labels="green_square\nrobot")


@pytest.mark.parametrize(
    "name, columns, confidences",
    [
        ("gt.txt", "0,4,1", []),
        ("gt.txt", "7,4,0.2", [1.0]),
        ("result.txt", "0,4,1", []),
        ("result.txt", "0,-1,-1,-1", [0.0]),
        ("result.txt", "-1,-1,-1,-1", [1.0]),
        ("result.txt", "0.25", [0.25]),
        ("GT.txt", "0,-1,-1,-1", []),
    ],
)
def test_column_7_is_a_flag_of_the_truth_and_else_a_confidence(read, name, columns, confidences):
    names = ("block",) * 4 if columns.count(",") == 2 else ("block",)
    frames, _ = read(f"1,1,11,21,20,40,{columns}", name, class_names=names)
    assert [confidence for _, _, confidence in frames[0]] == confidences


def test_lines_need_no_order_and_empty_boxes_are_none(read):
    lines = ["3,1,31,21,20,40,1,4,1", "1,1,11,21,20,40,1,4,1", "2,1,0,0,0,0,1,4,0"]
    frames, _ = read("\n".join(lines))
    assert [[box[0] for _, box, _ in frame] for frame in frames] == [[0.2], [], [0.4], []]
    assert read("") == ([[]] * 4, 30.0)
    assert read("2,-1,11,21,20,40,1,4,1\n2,-1,51,21,20,40,1,4,1")[0][1][1][1][0] == 0.6


REFUSED = {
    "words": ("a,b,c,d,e,f,g", "gt.txt, line 1: column 1 is 'a'; allowed: finite numbers"),
    "blanks alone": ("1 1 11 21 20 40 1", "line 1: 1 numbers; allowed: 7, 9 or 10, with commas between them"),
    "eight numbers": ("\n1,1,11,21,20,40,1,4", "line 2: 8 numbers; allowed: 7, 9 or 10"),
    "an empty column": ("1,1,11,,20,40,1,4,1", "column 4 is ''; allowed: finite numbers"),
    "no number": ("1,1,11,nan,20,40,1,4,1", "column 4 is 'nan'"),
    "frame 0": ("0,1,11,21,20,40,1,4,1", "line 1: frame is 0; allowed: whole numbers from 1 to 4"),
    "half a frame": ("1.5,1,11,21,20,40,1,4,1", "frame is 1.5"),
    "a frame after the end": ("5,1,11,21,20,40,1,4,1", "frame is 5; allowed: whole numbers from 1 to 4"),
    "half an id": ("1,1.5,11,21,20,40,1,4,1", "id is 1.5; allowed: whole numbers from -1"),
    "an id twice": (f"{LINE}\n{LINE}", "line 2: id 1 is in frame 2 twice; allowed: once"),
    "half a class": ("1,1,11,21,20,40,1,4.5,1", "class is 4.5"),
    "an unknown class": ("1,1,11,21,20,40,1,8,1", "class 8; allowed: 1, 2, 3, 4, 5, 6, 7, named by the object table"),
    "no class": ("1,1,11,21,20,40,1,-1,1", "class -1; allowed: 1, 2"),
    "a negative side": ("1,1,11,21,-20,40,1,4,1", "sides of 0 or more"),
    "far outside": ("1,1,1100,21,20,40,1,4,1", "line 1: the box (cx, cy, w, h) is 11.09"),
}


@pytest.mark.parametrize("text, message", REFUSED.values(), ids=REFUSED)
def test_what_is_wrong_with_a_line_is_one_sentence_that_names_it(read, text, message):
    with pytest.raises(ImportFailure) as failure:
        read(text)
    assert message in str(failure.value) and "gt.txt" in str(failure.value)


@pytest.mark.parametrize(
    "told, size, says",
    [
        (None, None, "gt.txt: the size of the images is missing; --size says it"),
        (SEQUENCE, (200, 100), "gt.txt: the images are 100 x 200, but 200 x 100 by --size"),
        (SEQUENCE.replace("imWidth=100\n", ""), None, "seqinfo.ini: one of imWidth and imHeight is missing"),
        (SEQUENCE.replace("=100", "=wide"), None, "seqinfo.ini: imWidth is 'wide'; allowed: finite numbers"),
        (SEQUENCE.replace("=100", "=0"), None, "the images are 0 x 200; allowed: sides above 0"),
        (SEQUENCE.replace("=30", "=0"), None, "seqinfo.ini: frameRate is 0; allowed: numbers above 0"),
        (SEQUENCE.replace("=4", "=0"), None, "seqinfo.ini: seqLength is 0; allowed: whole numbers from 1"),
        ("imWidth=100", None, "seqinfo.ini: no seqinfo.ini: File contains no section headers"),
        ("[Other]\n", None, "seqinfo.ini: no seqinfo.ini: No section: 'Sequence'"),
        (SEQUENCE + "imWidth=4\n", None, "seqinfo.ini: no seqinfo.ini: While reading"),
    ],
)
def test_what_is_wrong_with_a_sequence_is_one_sentence(read, told, size, says):
    with pytest.raises(ImportFailure) as failure:
        read(LINE, told=told, size=size)
    assert says in str(failure.value) and "\n" not in str(failure.value)


def test_an_empty_file_is_refused(tmp_path, capsys):
    (tmp_path / "gt.txt").write_text("\n")
    assert "gt.txt: no frames" in refused(capsys, tmp_path, "--size", 10, 10)


def test_files_are_told_by_their_names_or_first_lines(tmp_path):
    texts = {
        "gt.txt": "",
        "Det.txt": "x",
        "MOT16-01.txt": f"\ufeff\n{LINE}",
        "tracks.txt": "1, -1, 794.2, 47.5, 71.2, 174.8, 0.9, -1, -1, -1",
        "labels.txt": "robot",
        "frame_1.txt": "3,0.15,0.45,0.25,0.45,0.25,0.55,0.15,0.55",
        "frame_2.txt": "3,0,0,1,0,1,1,0,1",
        "frame_3.txt": "3 0.2 0.5 0.1 0.1",
        "corners_1.txt": "10,20,30,60",
        "empty_1.txt": "",
        "odd.txt": "\0\xff",
    }
    for name, text in texts.items():
        (tmp_path / name).write_text(text)
    found = {path.name for path in mot_files(sorted(tmp_path.iterdir()))}
    assert found == {"gt.txt", "Det.txt", "MOT16-01.txt", "tracks.txt"}
