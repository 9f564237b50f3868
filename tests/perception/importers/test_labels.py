"""Ready-made boxes come through; what is wrong with a line is one sentence that names it, and nothing is written."""

import imageio.v3 as imageio
import numpy as np
import pytest

from graphrl_jax.demonstrations import load
from graphrl_jax.perception.importers.convert import Source
from graphrl_jax.perception.importers.labels import label_files
from graphrl_jax.perception.importers.recording import ImportFailure
from tasks.match_regions.objects import OBJECTS
from tests.helpers.importing import SQUARE_BOX, refused, run


def write_labels(folder, lines):
    folder.mkdir(parents=True, exist_ok=True)
    for number, text in enumerate(lines):
        (folder / f"frame_{number}.txt").write_text(text)


def detections(folder):
    """Class and box of every detection in every frame of the one recording of a source."""
    (recording,) = Source(folder).recordings(OBJECTS)
    return [
        [(one.class_id, [round(float(value), 3) for value in one.box]) for one in frame]
        for frame in recording.detections
    ]


def test_yolos_labels(tmp_path, capsys):
    boxes = " ".join(map(str, SQUARE_BOX))
    write_labels(tmp_path / "a", [f"3 {boxes}\n", f"3 {boxes} 0.9\n\n"])
    write_labels(tmp_path / "b", [f"3 {boxes}\n"])
    run(tmp_path, "--out", tmp_path / "demos.npz")
    demos = load(tmp_path / "demos.npz")
    slot = OBJECTS.names.index("square")
    np.testing.assert_array_equal(demos.lengths, [2, 1])
    np.testing.assert_allclose(demos.boxes[0, :2, slot], [SQUARE_BOX] * 2)
    assert demos.mask[0, :2, slot].all() and demos.mask.sum() == 3
    write_labels(tmp_path / "b", [f"3 {boxes}\n9 {boxes}\n"])
    assert "frame_0.txt, line 2: class 9; allowed: 0 to 6" in refused(capsys, tmp_path)
    write_labels(tmp_path / "b", ["3 0.5 0.5 7 0.1"])
    assert "line 1: the box (cx, cy, w, h) is 0.5, 0.5, 7, 0.1; allowed: edges from -0.5 to" in refused(
        capsys, tmp_path
    )
    write_labels(tmp_path / "b", ["3 0.5 0.5"])
    assert "line 1: 3 numbers; allowed: class cx cy w h" in refused(capsys, tmp_path)
    write_labels(tmp_path / "b", ["three 0.5"])
    assert "line 1: 'three 0.5' is not a list of numbers" in refused(capsys, tmp_path)


def test_frames_without_labels_are_frames_in_which_nothing_was_seen(tmp_path, capsys):
    boxes = " ".join(map(str, SQUARE_BOX))
    for number in (1, 2, 9):
        (tmp_path / f"{number:03d}.txt").write_text(f"3 {boxes}")
    run(tmp_path, "--out", tmp_path / "demos.npz")
    demos = load(tmp_path / "demos.npz")
    np.testing.assert_array_equal(demos.mask[0, :, OBJECTS.names.index("square")], [1, 1, 0, 0, 0, 0, 0, 0, 1])
    (tmp_path / "100000.txt").write_text(f"3 {boxes}")
    (tmp_path / "demos.npz").unlink()
    assert "the files' numbers skip from 1 to 100000 in 4 files" in refused(capsys, tmp_path)


def test_corner_files(tmp_path, capsys):
    write_labels(tmp_path / "a", ["0 0 0 0\n10 20 30 60\n"])
    (recording,) = Source(tmp_path, "corners", (100, 200)).recordings(OBJECTS)
    ((detection,),) = recording.detections
    assert detection.class_id == OBJECTS.class_ids[1]
    np.testing.assert_allclose(detection.box, [0.2, 0.2, 0.2, 0.2])
    assert "the size of the images is missing" in refused(capsys, tmp_path / "a", "--format", "corners")
    write_labels(tmp_path / "a", ["1 2 3 4\n" * 9])
    arguments = (tmp_path / "a", "--format", "corners", "--size", 100, 200)
    assert "line 9: more lines than the table's 8 objects" in refused(capsys, *arguments)
    write_labels(tmp_path / "b", ["0 0.5 0.5 0.1 0.1\n"] * 2)
    message = "--size changes nothing with format yolo, whose files say it; leave it out"
    assert message in refused(capsys, tmp_path / "b", "--size", 100, 200)


BOX = (3, [0.2, 0.5, 0.1, 0.1])


@pytest.mark.parametrize(
    "line",
    [
        "3 0.2 0.5 0.1 0.1",
        "3.0 0.2 0.5 0.1 0.1 1",
        "3\t0.2\t0.5\t0.1\t0.1\r\n\r\n",
        "3,0.2,0.5,0.1,0.1",
        "3, 0.2, 0.5, 0.1, 0.1, 0.94",
        "3 0.15 0.45 0.25 0.45 0.25 0.55 0.15 0.55",
        "3 0.15 0.45 0.25 0.45 0.25 0.55 0.15 0.55 0.8",
        "3 0.15 0.45 0.25 0.45 0.25 0.5 0.25 0.55 0.15 0.55",
        "3 0.2 0.5 0.1 0.1\n2 0 0 0 0",
    ],
)
def test_lines_of_exporters(tmp_path, line):
    write_labels(tmp_path, [line])
    assert detections(tmp_path) == [[BOX]]


@pytest.mark.parametrize(
    "line, message",
    [
        ("3 0.2 0.5 0.1 0.1 7", "line 1: number 6 is 7; allowed: a confidence from 0 to 1"),
        ("3 0.2 0.5 0.1 0.1 45.5", "number 6 is 45.5"),
        ("3 0.2 0.5 0.1 0.1 nan", "number 6 is nan"),
        ("3 0.2 0.5 0.1 0.1 0.9 1", "7 numbers; allowed: class cx cy w h [confidence], or class and a polygon"),
        ("3 0.2 0.5 0.1", "4 numbers"),
        ("3 64 32 10 10", "the box (cx, cy, w, h) is 64, 32, 10, 10"),
        ("3 15 45 25 45 25 55 15 55", "the polygon has a point at 15; allowed: 0 to 1"),
        ("3 0.2 0.5 -0.1 0.1", "sides of 0 or more"),
        ("3 1.4 0.5 0.9 0.1", "the box (cx, cy, w, h) is 1.4, 0.5, 0.9, 0.1"),
        ("3 0.2 inf 0.1 0.1", "is 0.2, inf, 0.1, 0.1"),
        ("2.5 0.2 0.5 0.1 0.1", "class 2.5; allowed: whole numbers"),
        ("nan 0.2 0.5 0.1 0.1", "class nan"),
        ("-1 0.2 0.5 0.1 0.1", "class -1; allowed: 0 to 6"),
        ("3 0,2 0,5 0,1 0,1", "is not a list of numbers"),
        ("green_square 0.2 0.5 0.1 0.1", "is not a list of numbers"),
    ],
)
def test_a_column_that_cannot_be_what_it_is_taken_for_is_refused(tmp_path, capsys, line, message):
    write_labels(tmp_path / "a", [f"{line}\n"])
    assert message in refused(capsys, tmp_path / "a")


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_a_byte_order_mark_is_no_part_of_the_line(tmp_path, encoding):
    (tmp_path / "0.txt").write_text("3 0.2 0.5 0.1 0.1\n", encoding)
    assert detections(tmp_path) == [[BOX]]
    (tmp_path / "0.txt").write_bytes(b"3 0.2\xff")
    with pytest.raises(ImportFailure, match="0.txt: no text in UTF-8"):
        detections(tmp_path)


@pytest.mark.parametrize("source", ["", "labels"])
@pytest.mark.parametrize(
    "name, text", [("data.yaml", "names: [green_square, cat]"), ("classes.txt", "green_square\ncat")]
)
def test_class_names_that_come_with_labels_decide(tmp_path, capsys, source, name, text):
    write_labels(tmp_path / "set" / "labels", ["0 0.2 0.5 0.1 0.1"])
    (tmp_path / "set" / name).write_text(text)
    assert detections(tmp_path / "set" / source) == [[BOX]]
    write_labels(tmp_path / "set" / "labels", ["1 0.2 0.5 0.1 0.1"])
    assert "class 1 is 'cat' by" in refused(capsys, tmp_path / "set")


def test_other_files_of_an_exporter_are_left_out(tmp_path):
    write_labels(tmp_path / "labels", ["3 0.2 0.5 0.1 0.1", ""])
    texts = {
        "README.roboflow": "Exported",
        "train": "images/frame_0.jpg",
        "notes": "a b",
        "classes": "4\n5",
        "odd": "é",
    }
    for name, text in texts.items():
        (tmp_path / f"{name}.txt").write_text(text, "latin-1")
    (tmp_path / "start.txt").write_text("3 0.2 0.5 0.1 0.1")
    found = label_files(sorted(tmp_path.rglob("*.txt")))
    assert [path.name for path in found] == ["frame_0.txt", "frame_1.txt", "start.txt"]
    (tmp_path / "start.txt").unlink()
    (tmp_path / "classes.txt").unlink()
    (tmp_path / "notes.json").write_text('{"categories": []}')
    assert detections(tmp_path) == [[BOX], []]


@pytest.mark.parametrize("labels, images", [("labels", "images"), ("labels/train", "images/train"), ("", "")])
def test_images_beside_labels_say_which_frames_there_are(tmp_path, labels, images):
    write_labels(tmp_path / labels, ["3 0.2 0.5 0.1 0.1"] * 2)
    (tmp_path / images).mkdir(parents=True, exist_ok=True)
    for number in range(4):
        imageio.imwrite(tmp_path / images / f"frame_{number}.png", np.zeros((8, 8, 3), np.uint8))
    imageio.imwrite(tmp_path / images / "preview.png", np.zeros((8, 8, 3), np.uint8))
    assert detections(tmp_path) == [[BOX], [BOX], [], []]
    (tmp_path / images / "frame_1.png").unlink()
    assert detections(tmp_path) == [[BOX], [BOX]]


def test_several_videos_in_one_folder_are_several_demonstrations(tmp_path):
    for name, x in (("a_1", 0.1), ("a_2", 0.2), ("a_4", 0.4), ("b_1", 0.8), ("b_2", 0.7), ("b_3", 0.6)):
        (tmp_path / f"pick_{name}.txt").write_text(f"3 {x} 0.5 0.1 0.1")
    run(tmp_path, "--out", tmp_path / "demos.npz")
    demos = load(tmp_path / "demos.npz")
    np.testing.assert_array_equal(demos.lengths, [4, 3])
    x = demos.boxes[:, :, OBJECTS.names.index("square"), 0]
    np.testing.assert_allclose(x, [[0.1, 0.2, 0.3, 0.4], [0.8, 0.7, 0.6, 0.0]], atol=1e-6)


def test_the_most_confident_box_is_tracked(tmp_path, capsys):
    write_labels(tmp_path, [f"3 0.2 0.5 0.1 0.1 0.26\n3 {x} 0.5 0.1 0.1 0.94\n" for x in (0.7, 0.71, 0.72)])
    run(tmp_path, "--out", tmp_path / "demos.npz")
    x = load(tmp_path / "demos.npz").boxes[0, :, OBJECTS.names.index("square"), 0]
    np.testing.assert_allclose(x, [0.7, 0.71, 0.72])
    assert "boxes dropped for want of a slot: 3" in " ".join(capsys.readouterr().err.split())
