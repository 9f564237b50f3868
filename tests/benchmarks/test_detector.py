"""The drawn dataset has true boxes, and what is said about a detector is arithmetic."""

import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pyarrow as pa
import pytest
import yaml
from PIL import Image

from benchmarks import detector
from docs.examples.desk import make_videos as desk
from graphrl_jax.graph import ObjectTable
from graphrl_jax.perception.detector import Detection
from graphrl_jax.reward.annotations import write_table
from graphrl_jax.storage import read_json, write_json
from tests.helpers.outside_package import REPOSITORY

NAMES = ("hand", "tray", "cup", "book")
SIZE = np.array([desk.WIDTH, desk.HEIGHT] * 2)


def test_true_boxes_by_hand():
    places = {"tray": np.array([200.0, 100.0]), "cup": np.array([50.6, 60.2])}
    tray, cup = detector.true_boxes(places, ("tray", "cup")) * SIZE
    # 96 x 76 around (200, 100): pixels 152 to 248 and 62 to 138, both drawn.
    np.testing.assert_allclose(tray, [200.5, 100.5, 97, 77], rtol=1e-5)
    # 26 x 26 around (50.6, 60.2): pixels 37 to 63 and 47 to 73.
    np.testing.assert_allclose(cup, [50.5, 60.5, 27, 27], rtol=1e-5)


def test_true_boxes_are_those_of_the_pixels(monkeypatch):
    monkeypatch.setattr(desk, "NOISE", 0.0)
    draw = np.random.default_rng(0)
    places = {
        name: np.array(place) for name, place in zip(NAMES, [(90, 200), (235, 120), (60, 60), (130, 90)], strict=True)
    }
    for _ in range(5):
        shifted = {name: place + draw.uniform(-5, 5, 2) for name, place in places.items()}
        image = desk.image(shifted, draw)
        for name, box in zip(NAMES, detector.true_boxes(shifted, NAMES) * SIZE, strict=True):
            rows, columns = np.nonzero((image == desk.COLOURS[name]).all(-1))
            edges = [columns.min(), rows.min(), columns.max() + 1, rows.max() + 1]
            slack = 1.01 if name in ("hand", "cup") else 0.01  # the outermost pixel of a round thing may be missing
            np.testing.assert_allclose(detector.corners(box), edges, atol=slack, err_msg=name)


def test_the_files_of_a_dataset(tmp_path):
    path = detector.write_dataset(tmp_path / "data", NAMES, {"train": 6, "val": 3}, seed=1)
    told = yaml.safe_load(path.read_text())
    assert told.pop("path") == str(tmp_path / "data")
    assert told == {"train": "images/train", "val": "images/val", "names": dict(enumerate(NAMES))}
    for split, count in (("train", 6), ("val", 3)):
        for kind, ending in (("images", "jpg"), ("labels", "txt")):
            found = sorted(one.name for one in (path.parent / kind / split).iterdir())
            assert found == [f"{number:05d}.{ending}" for number in range(count)]
    images, truth = detector.unseen(path)
    drawn = list(detector.drawn_images(3, NAMES, (1, detector.UNSEEN)))
    np.testing.assert_allclose(truth, np.stack([boxes for _, boxes in drawn]), atol=1e-6)
    assert np.mean([np.abs(one - two.astype(float)).mean() for one, (two, _) in zip(images, drawn, strict=True)]) < 4
    first = Image.open(path.parent / "images" / "train" / "00000.jpg")
    boxes = np.loadtxt(path.parent / "labels" / "train" / "00000.txt")
    assert boxes[:, 0].tolist() == [0, 1, 2, 3]
    corner = (boxes[1, 1:3] - 0.4 * boxes[1, 3:]) * SIZE[:2]  # inside the tray, beside what is put on it
    np.testing.assert_allclose(first.getpixel(tuple(map(int, corner))), desk.COLOURS["tray"], atol=25)


def test_the_lines_of_labels():
    boxes = np.array([[0.5, 0.25, 0.125, 0.0625], [0, 1, 0.1, 1 / 3]])
    assert detector.label_text(boxes) == (
        "0 0.500000 0.250000 0.125000 0.062500\n1 0.000000 1.000000 0.100000 0.333333\n"
    )


def test_a_detector_is_judged_by_its_most_confident_box():
    left, right = np.array([0.2, 0.5, 0.2, 0.2]), np.array([0.7, 0.5, 0.2, 0.2])
    half = np.array([0.25, 0.5, 0.1, 0.2])  # the right half of the left box
    answers = iter(
        [
            [Detection(0, left, 0.9), Detection(0, right, 0.6), Detection(1, right, 0.8)],
            [Detection(0, half, 0.7), Detection(1, left, 0.6)],
            [Detection(0, left, 0.5)],
            [],
        ]
    )
    truth = np.broadcast_to(np.stack([left, right]), (4, 2, 4))
    images = [np.zeros((2, 2, 3), np.uint8)] * 4
    rows = detector.judged(SimpleNamespace(detect=lambda image: next(answers)), images, truth, ("left", "right"))
    assert rows["left"] == pytest.approx(
        {"found": 0.75, "mean_iou": (1 + 0.5 + 1) / 3, "least_iou": 0.5, "identity_errors": 0},
        rel=1e-5,
    )
    assert rows["right"] == pytest.approx(
        {"found": 0.5, "mean_iou": 0.5, "least_iou": 0, "identity_errors": 1}, rel=1e-5
    )


def test_what_is_in_the_middle_of_the_hand_is_held():
    hand, near, far = [0.5, 0.5, 0.2, 0.4], [0.54, 0.41, 0.1, 0.1], [0.56, 0.5, 0.1, 0.1]
    boxes = np.array([[hand, near], [hand, far]])
    assert detector.held_by_hand(boxes, ("hand", "cup"), "cup").tolist() == [True, False]


def test_tracked_boxes_are_compared_up_to_the_end_of_each_recording():
    truth = [np.full((2, 1, 4), 0.5, np.float32), np.full((1, 1, 4), 0.5, np.float32)]
    boxes = np.full((2, 2, 1, 4), 0.5, np.float32)
    boxes[0, 1, 0] = [0.5, 0.5, 0.25, 0.5]
    boxes[1, 1] = 0  # padding
    mask = np.array([[[True], [True]], [[True], [False]]])
    table = ObjectTable(names=("cup",), class_ids=(0,), is_robot=(False,), class_names=("cup",))
    demos = SimpleNamespace(boxes=boxes, mask=mask, objects=table)
    rows = detector.tracked(demos, truth)["cup"]
    assert rows == pytest.approx({"found": 1, "mean_iou": (1 + 0.5 + 1) / 3, "least_iou": 0.5})


def test_rewards_are_compared_frame_by_frame(tmp_path):
    def write(folder, rewards, ends, times=1):
        """A recording's own frames are `times` as many as those of the model's rate."""
        columns = {
            "episode_index": np.repeat([0, 1], 3 * times),
            "reward": np.repeat(np.array(rewards, np.float32), times),
        }
        write_table(folder / "progress.parquet", pa.table(columns))
        rows = [
            {
                "recording": f"in/{name}.mp4",
                "episode_index": number,
                "frames": 3,
                "final_progress": end,
                "looks_like_success": end > 0.5,
            }
            for number, (name, end) in enumerate(ends.items())
        ]
        write_json(folder / "scores.json", {"recordings": rows[::-1]})

    write(tmp_path / "ours", [-1, -0.5, 0, -1, -1.25, -0.75], {"both": 0.9, "cup": 0.6}, times=2)
    write(tmp_path / "true", [-1, -0.5, -0.25, -1, -1, -0.5], {"both": 0.75, "cup": 0.5})
    found = detector.compared(tmp_path / "ours", tmp_path / "true")
    assert found["reward_difference"] == pytest.approx({"mean": 0.75 / 6, "most": 0.25})
    # The ranks 2, 1, 3 beside 1.5, 1.5, 3 correlate by 1.5 / sqrt(2 * 1.5).
    assert found["rank_correlation"]["of_frames"] == pytest.approx(
        {"mean": (1.5 / 3**0.5 + 1) / 2, "least": 1.5 / 3**0.5}
    )
    assert found["rank_correlation"]["of_recordings"] == pytest.approx(1)
    assert found["recordings"]["cup"] == {
        "detected": {"final_progress": 0.6, "looks_like_success": True},
        "true": {"final_progress": 0.5, "looks_like_success": False},
        "rank_correlation": pytest.approx(1.5 / 3**0.5),
    }


def test_another_detector_needs_another_folder(tmp_path):
    detector.refuse_another(detector.Options(work=tmp_path))
    detector.refuse_another(detector.Options(work=tmp_path))
    with pytest.raises(ValueError, match="is of a detector with .*'epochs': 12.*; choose another folder"):
        detector.refuse_another(detector.Options(work=tmp_path, epochs=3))


def test_whatever_is_tried_on_the_network_is_refused_and_told(tmp_path):
    code = f"""
import pathlib, socket
from benchmarks.detector import keep_offline
tried = keep_offline(pathlib.Path({str(tmp_path)!r}))
one, other = socket.socketpair()
for attempt in (lambda: socket.getaddrinfo("localhost", 80), lambda: socket.create_connection(("127.0.0.1", 9))):
    try:
        attempt()
    except OSError as error:
        print(error)
print(len(tried))
"""
    answer = subprocess.run([sys.executable, "-c", code], cwd=REPOSITORY, capture_output=True, text=True, check=True)
    assert answer.stdout.splitlines()[-3:] == ["this benchmark does not use the network"] * 2 + ["2"]
    assert (tmp_path / "settings" / "Ultralytics" / "Arial.ttf").exists()


def test_the_documents_tell_the_results():
    told = read_json(REPOSITORY / detector.RESULTS / "detector.json")
    pages = {
        name: " ".join((REPOSITORY / "docs" / f"{name}.md").read_text().split()) for name in ("benchmarks", "video")
    }
    rows, speed, apart = told["unseen_images"], told["frames_per_second"], told["reward_difference"]
    looks = [[row[kind]["looks_like_success"] for row in told["recordings"].values()] for kind in ("detected", "true")]
    found = {name: f"{row['found']:.0%} with".replace("%", " %") for name, row in rows.items()}
    assert "the hand is found in {hand} a mean overlap (IoU) of".format(**found) in pages["benchmarks"]
    assert all(f"{row['mean_iou']:.2f}" in pages["benchmarks"] for row in rows.values())
    for text in (
        "the tray in {tray} {0:.2f}, the cup in {cup} {1:.2f} and the book in {book} {2:.2f}".format(
            *(rows[name]["mean_iou"] for name in ("tray", "cup", "book")), **found
        ),
        f"the least overlap is {min(row['least_iou'] for row in rows.values()):.2f}.",
        f"where {100 * told['cup_in_hand']['found']:.0f} % are found",
        f"differ by {apart['mean']:.3f} on average from those of true boxes, and by up to {apart['most']:.2f}.",
        f"sees {speed['of_the_cores_time']:.0f} frames per second of a core's time, and the videos play "
        f"{told['video_frames_per_second']}; by the clock it saw {speed['by_the_clock']:.0f},",
    ):
        assert text in pages["benchmarks"]
    assert f"differ by {apart['mean']:.3f} on average" in pages["video"]
    assert f"{told['training']['cpu_seconds'] / 60:.0f} minutes of one core" in pages["video"]
    assert sum(row["identity_errors"] for row in rows.values()) == 0 and not told["tried_on_the_network"]
    assert told["rank_correlation"]["of_recordings"] == pytest.approx(1) and looks[0] == looks[1] and len(looks[0]) == 8
    for name in ("cup", "book"):
        row = told["red_and_blue_exchanged"][name]
        assert row["identity_errors"] == round(row["found"] * told["training"]["unseen"]) > 0
