"""COCO's JSON: what an exporter writes comes through, and what is unclear is one sentence."""

import json

import numpy as np
import pytest

from graphrl_jax.demonstrations import load
from graphrl_jax.perception.importers.coco import coco_files, read_coco
from graphrl_jax.perception.importers.recording import ImportFailure
from tasks.match_regions.objects import OBJECTS
from tests.helpers.importing import refused, run


def content(names, **fields):
    """One square per image, at x = 10, 20, ... of 100 pixels, in the order of the names."""
    return {
        "categories": [{"id": 5, "name": "green_square"}],
        "images": [
            {"id": n, "file_name": name, "width": 100, "height": 100}
            | {key: values[n] for key, values in fields.items()}
            for n, name in enumerate(names)
        ],
        "annotations": [
            {"id": n, "image_id": n, "category_id": 5, "bbox": [10 * n + 5, 10, 10, 20]} for n in range(len(names))
        ],
    }


@pytest.fixture
def read(tmp_path):
    """The recordings of a file with this content: x of the square per frame, None where it is not seen."""

    def read(written, encoding="utf-8"):
        path = tmp_path / "boxes.json"
        path.write_text(json.dumps(written), encoding)
        recordings = list(read_coco([path], OBJECTS.class_names))
        assert all(len(frame) <= 1 for one in recordings for frame in one.detections)
        return [[round(float(f[0].box[0]), 3) if f else None for f in one.detections] for one in recordings]

    return read


def test_cocos_json(tmp_path, capsys):
    written = content(["video/2.png", "video/10.png"])
    path = tmp_path / "boxes.json"
    path.write_text(json.dumps(written))
    run(path, "--out", tmp_path / "demos.npz")
    demos = load(tmp_path / "demos.npz")
    slot = OBJECTS.names.index("square")
    np.testing.assert_allclose(demos.boxes[0, 0, slot], [0.1, 0.2, 0.1, 0.2])
    written["categories"][0]["name"] = "cat"
    path.write_text(json.dumps(written))
    assert "annotations[0]: category 'cat'; allowed: goal_region" in refused(capsys, path)
    path.write_text("{}")
    assert "not COCO's JSON" in refused(capsys, path)


@pytest.mark.parametrize(
    "names, recordings",
    [
        (["v/10.png", "v/2.png", "v/3.png"], [[0.2, 0.3, *[None] * 6, 0.1]]),
        (["images/e51b2c07-frame_2.png", "images/09d4aa31-frame_1.png"], [[0.2, 0.1]]),
        (["take_9\\cam\\2.png", "take_9\\cam\\1.png"], [[0.2, 0.1]]),
        (["001.png", "002.png", "009.png"], [[0.1, 0.2, None, None, None, None, None, None, 0.3]]),
        (["b/1.png", "b/2.png", "a/1.png", "a/2.png"], [[0.3, 0.4], [0.1, 0.2]]),
        (["a_1.png", "a_2.png", "b_1.png", "b_2.png"], [[0.1, 0.2], [0.3, 0.4]]),
    ],
)
def test_images_are_recordings_in_the_order_of_their_frame_numbers(read, names, recordings):
    assert read(content(names)) == recordings


def test_ids_of_videos_and_frames_decide(read):
    names = [f"{n}.png" for n in range(5)]
    assert read(content(names, video_id=[1, 2, 1, 2, 1], frame_id=[2, 0, 1, 1, 4])) == [
        [0.3, 0.1, None, 0.5],
        [0.2, 0.4],
    ]
    assert read(content(["take.mp4"] * 3, video_id=[1] * 3, frame_id=[1, 0, 2])) == [[0.2, 0.1, 0.3]]
    assert read(content(["1.png", "2.png", "1.png"], video_id=[1, 1, 2])) == [[0.1, 0.2], [0.3]]
    with pytest.raises(ImportFailure, match="both are frame 3"):
        read(content(names, video_id=[1] * 5, frame_id=[1, 2, 3, 3, 4]))


def test_crowds_are_no_objects_and_scores_are_confidences(read):
    written = content(["1.png", "2.png"])
    crowd = {"image_id": 0, "category_id": 5, "bbox": [0, 0, 60, 100], "iscrowd": 1}
    written["annotations"] = [crowd, *(one | {"iscrowd": 0} for one in written["annotations"])]
    assert read(written) == [[0.1, 0.2]]
    written["annotations"][1]["score"] = 12
    with pytest.raises(ImportFailure, match=r"annotations\[1\]: score is 12; allowed: a confidence from 0 to 1"):
        read(written)


@pytest.mark.parametrize("bbox", [{"bbox": []}, {"bbox": None}, {}, {"bbox": [0, 0, 0, 0]}])
@pytest.mark.parametrize(
    "segmentation", [[[10, 10, 20, 10, 20, 30, 10, 30]], [[10, 10, 12, 12, 10, 12], [18, 28, 20, 30, 18, 30]]]
)
def test_a_box_follows_from_polygons(read, bbox, segmentation):
    written = content(["1.png"])
    written["annotations"] = [{"image_id": 0, "category_id": 5, "segmentation": segmentation, **bbox}]
    assert read(written) == [[0.15]]


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16"])
def test_a_byte_order_mark_is_no_part_of_the_text(read, encoding):
    assert read(content(["größe_1.png", "größe_2.png"]), encoding) == [[0.1, 0.2]]


REFUSED = {
    "a name twice": (lambda c: c["images"][1].update(file_name="1.png"), "1.png is listed twice"),
    "an image's id twice": (lambda c: c["images"][1].update(id=0), "images: id 0 is listed twice"),
    "a category's id twice": (lambda c: c["categories"].append(c["categories"][0]), "categories: id 5 is listed twice"),
    "an image that is not listed": (lambda c: c["annotations"][1].update(image_id="1"), "image_id is '1'"),
    "a category that is not listed": (lambda c: c["annotations"][1].update(category_id=[]), "category_id is []"),
    "no box at all": (lambda c: c["annotations"][1].update(bbox=[]), "annotations[1]: bbox is missing"),
    "a run-length code alone": (
        lambda c: c["annotations"][1].update(bbox=[], segmentation={"counts": "1", "size": [1, 1]}),
        "segmentation holds no polygon",
    ),
    "three numbers": (lambda c: c["annotations"][1].update(bbox=[1, 2, 3]), "bbox is [1, 2, 3]; allowed: x0, y0, w, h"),
    "no number": (lambda c: c["annotations"][1].update(bbox=[1, 2, 3, float("nan")]), "bbox is nan"),
    "a text": (lambda c: c["annotations"][1].update(bbox=[1, 2, 3, "4"]), "bbox is '4'; allowed: finite numbers"),
    "a negative side": (lambda c: c["annotations"][1].update(bbox=[1, 2, -3, 4]), "sides of 0 or more"),
    "far outside": (lambda c: c["annotations"][1].update(bbox=[1000, 2, 3, 4]), "in units of the image"),
    "an odd polygon": (lambda c: c["annotations"][1].update(bbox=[], segmentation=[[1, 2, 3]]), "has 3 numbers"),
    "no width": (lambda c: c["images"][1].pop("width"), "annotations[1]: width of its image is None"),
    "no height": (lambda c: c["images"][1].update(height=0), "width and height of its image are"),
    "a frame's number that is a text": (lambda c: c["images"][1].update(frame_id="7"), "frame_id is '7'"),
    "an annotation that is a list": (lambda c: c["annotations"].append([1]), "not COCO's JSON"),
}


@pytest.mark.parametrize("change, message", REFUSED.values(), ids=REFUSED)
def test_what_is_wrong_is_one_sentence_that_names_it(read, change, message):
    written = content(["1.png", "2.png"])
    change(written)
    with pytest.raises(ImportFailure) as failure:
        read(written)
    assert message in str(failure.value) and "boxes.json" in str(failure.value)


def test_other_json_is_left_out(tmp_path):
    texts = {"notes": '{"categories": [], "info": {}}', "boxes": '{"images": [], "annotations": []}', "empty": ""}
    for name, text in texts.items():
        (tmp_path / f"{name}.json").write_text(text)
    (tmp_path / "wide.json").write_text(texts["boxes"], "utf-16")
    found = coco_files(sorted(tmp_path.iterdir()))
    assert [path.name for path in found] == ["boxes.json", "wide.json"]
