"""Ready-made boxes come through; what is wrong with a line is one sentence that names it, and nothing is written."""

import json

import numpy as np

from graphrl_jax.demonstrations import load
from graphrl_jax.perception.importers.convert import Source
from tasks.match_regions.objects import OBJECTS
from tests.helpers.importing import SQUARE_BOX, refused, run


def write_labels(folder, lines):
    folder.mkdir(parents=True, exist_ok=True)
    for number, text in enumerate(lines):
        (folder / f"frame_{number}.txt").write_text(text)


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
    assert "line 1: the box (cx, cy, w, h) is 0.5, 0.5, 7, 0.1; allowed: -0.5 to 1.5" in refused(capsys, tmp_path)
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


def test_cocos_json(tmp_path, capsys):
    content = {
        "categories": [{"id": 5, "name": "green_square"}],
        "images": [{"id": n, "file_name": f"video/{n}.png", "width": 200, "height": 100} for n in (10, 2)],
        "annotations": [{"image_id": n, "category_id": 5, "bbox": [20 + n, 10, 40, 20]} for n in (10, 2)],
    }
    path = tmp_path / "boxes.json"
    path.write_text(json.dumps(content))
    run(path, "--out", tmp_path / "demos.npz")
    demos = load(tmp_path / "demos.npz")
    slot = OBJECTS.names.index("square")
    np.testing.assert_allclose(demos.boxes[0, :, slot, 0], [0.21, 0.25])  # frame 2 comes before frame 10
    np.testing.assert_allclose(demos.boxes[0, :, slot, 1:], [[0.2, 0.2, 0.2]] * 2)
    content["categories"][0]["name"] = "cat"
    path.write_text(json.dumps(content))
    assert "annotations[0]: category 'cat'; allowed: goal_region" in refused(capsys, path)
    path.write_text("{}")
    assert "not COCO's JSON" in refused(capsys, path)
