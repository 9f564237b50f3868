"""Label Studio's JSON: boxes on images and tracks through videos come through, what is unclear is one sentence."""

import json

import numpy as np
import pytest

from graphrl_jax.demonstrations import load
from graphrl_jax.perception.importers.label_studio import label_studio_files, read_label_studio
from graphrl_jax.perception.importers.recording import ImportFailure
from tasks.match_regions.objects import OBJECTS
from tests.helpers.importing import refused, run

SQUARE = OBJECTS.class_names.index("green_square")


def annotation(*results, **more):
    return {"id": 7, "was_cancelled": False, "ground_truth": False, "result": list(results)} | more


def rectangle(x=10, y=20, width=20, height=30, rotation=0, label="green_square"):
    """A box on an image of 200 x 100 pixels, in percent."""
    value = {"x": x, "y": y, "width": width, "height": height, "rotation": rotation, "rectanglelabels": [label]}
    sizes = {"original_width": 200, "original_height": 100, "image_rotation": 0}
    return {"id": "Dx_aB1", "type": "rectanglelabels", "from_name": "label", "to_name": "image", "value": value} | sizes


def image(name, *annotations, key="image"):
    return {"id": 1, "data": {key: name}, "annotations": list(annotations) or [annotation(rectangle())]}


def key(frame, x=10, enabled=True, **more):
    at = {"frame": frame, "time": frame / 24, "enabled": enabled}
    return at | {"x": x, "y": 20, "width": 20, "height": 30, "rotation": 0} | more


def track(*sequence, frames=6, duration=0.25, label="green_square", **more):
    value = {"framesCount": frames, "duration": duration, "sequence": list(sequence), "labels": [label]}
    return {"id": "K3", "type": "videorectangle", "from_name": "box", "to_name": "video", "value": value} | more


def video(*tracks, **more):
    return {
        "id": 12,
        "data": {"video": "/data/upload/1/e51b2c07-pick.mp4"},
        "annotations": [annotation(*tracks)],
    } | more


@pytest.fixture
def write(tmp_path):
    def write(content, encoding="utf-8"):
        path = tmp_path / "export.json"
        path.write_text(json.dumps(content, ensure_ascii=False), encoding)
        return path

    return write


@pytest.fixture
def read(write):
    """The recordings of a file with this content: the left edge in percent, per frame, None where it is absent."""

    def read(*tasks, size=None, encoding="utf-8"):
        recordings = list(read_label_studio([write(list(tasks), encoding)], OBJECTS.class_names, size))
        frames = [frame for one in recordings for frame in one.detections]
        assert all(len(frame) <= 1 and all(found.class_id == SQUARE for found in frame) for frame in frames)
        return [
            [round(100 * float(f[0].box[0] - f[0].box[2] / 2), 3) if f else None for f in one.detections]
            for one in recordings
        ]

    return read


def only_box(path, frame=0, size=None):
    ((*_, recording),) = [list(read_label_studio([path], OBJECTS.class_names, size))]
    return recording.detections[frame][0].box


def test_images_are_frames_in_the_order_of_their_numbers(tmp_path, write):
    names = ["/data/upload/3/e51b2c07-frame_10.png", "/data/upload/3/09d4aa31-frame_9.png"]
    path = write([image(names[0], annotation(rectangle(x=30))), image(names[1])])
    run(path, "--out", tmp_path / "demos.npz")
    demos = load(tmp_path / "demos.npz")
    boxes = demos.boxes[0, :, OBJECTS.names.index("square")]
    np.testing.assert_allclose(boxes, [[0.2, 0.35, 0.2, 0.3], [0.4, 0.35, 0.2, 0.3]], rtol=1e-6)


def test_a_turned_box_is_enclosed_in_pixels(write):
    """40 x 30 pixels about (100, 20), a quarter clockwise: from (70, 20) to (100, 60), of 200 x 100 pixels."""
    turned = rectangle(50, 20, 20, 30, rotation=90)
    box = only_box(write([image("1.png", annotation(turned))]))
    np.testing.assert_allclose(box, [0.425, 0.4, 0.15, 0.4], rtol=1e-6)


@pytest.mark.parametrize(
    "names",
    [
        ["/data/local-files/?d=a/2.png", "/data/local-files/?d=a%2F1.png", "/data/local-files/?d=b/1.png"],
        ["https://host/a/2.png?X-Date=20240101T000000Z", "https://host/a/1.png?X-Date=9", "https://host/b/1.png"],
        ["s3://bucket/a/2.jpg", "s3://bucket/a/1.jpg", "s3://bucket/b/1.jpg"],
        ["C:\\a\\2.PNG", "C:\\a\\1.PNG", "C:\\b\\1.PNG"],
        ["take#1/frame%2.png", "take#1/frame%1.png", "b/frame.png"],
    ],
)
def test_names_of_images_are_paths_or_addresses(read, names):
    tasks = [image(name, annotation(rectangle(x=x))) for name, x in zip(names, (20, 10, 30), strict=True)]
    assert sorted(read(*tasks)) == [[10, 20], [30]]


def test_other_data_are_no_images(read):
    task = image("frames/1.png", key="img")
    task["data"] |= {"task": "pick the square", "number": 3, "video": "a.mp4"}
    assert read(task) == [[10]]
    for data in ({}, {"a": "1.png", "b": "2.png"}, {"image": ["1.png"]}):
        with pytest.raises(ImportFailure, match=r"export.json: \[0\]: data name . images; allowed: one"):
            read(task | {"data": data})


def test_which_annotation_counts(read):
    cancelled, other = annotation(rectangle(x=90), was_cancelled=True), annotation(rectangle(x=50))
    truth = annotation(rectangle(), ground_truth=True)
    empty = {"id": 3, "data": {"image": "7.png"}, "annotations": []}
    predicted = {"predictions": [{"result": [rectangle(x=70)]}]}
    tasks = [image("1.png", cancelled, annotation(rectangle())) | predicted, image("2.png", other, truth)]
    assert read(*tasks, empty, image("4.png", cancelled)) == [[10, 10]]
    with pytest.raises(ImportFailure, match=r"\[1\]: 2 annotations; allowed: one, or one with ground_truth"):
        read(image("1.png"), image("2.png", other, annotation(rectangle())))


def test_results_that_are_no_objects_are_left_out(read):
    choice = {"type": "choices", "value": {"choices": ["good"], "x": 1, "y": 1}}
    assert read(image("1.png", annotation(choice, rectangle())), image("2.png", annotation())) == [[10, None]]


def test_a_track_lives_between_its_key_frames(read):
    assert read(video(track(key(2, 10), key(4, 20)))) == [[None, 10, 15, 20, 20, 20]]
    assert read(video(track(key(4, 20, enabled=False), key(2, 10)))) == [[None, 10, 15, 20, None, None]]
    assert read(video(track(key(1, 10, enabled=False), key(4, 20), key(6, 30)))) == [[10, None, None, 20, 25, 30]]
    filled = [key(1, 10), key(2, 15, auto=True), key(3, 20, enabled=False)]
    assert read(video(track(*filled))) == [[10, 15, 20, None, None, None]]


def test_a_video_is_a_recording_at_the_annotators_rate(tmp_path, write):
    tasks = [video(track(key(1, 10), key(5, 50))), video(track(key(1, 70)), id=13)]
    first, second = read_label_studio([write(tasks)], OBJECTS.class_names)
    assert (first.frame_rate, len(first.detections)) == (24.0, 6)
    assert (first.source.name, second.source.name) == ("task_12", "task_13")
    run(tmp_path / "export.json", "--out", tmp_path / "demos.npz", "--frame-rate", 12)
    demos = load(tmp_path / "demos.npz")
    assert demos.frame_rate == 12
    x = demos.boxes[:, :, OBJECTS.names.index("square"), 0]
    np.testing.assert_allclose(x, [[0.2, 0.4, 0.6], [0.8, 0.8, 0.8]], rtol=1e-6)
    (unknown,) = read_label_studio([write([video(track(key(1), duration=None))])], OBJECTS.class_names)
    assert unknown.frame_rate is None


def test_turned_boxes_in_videos_need_the_size(write):
    """Half-way between 350 and 10 degrees the box is not turned."""
    sequence = [key(1, rotation=350), key(3, rotation=10)]
    for size, more in (((200, 100), {}), (None, {"original_width": 200, "original_height": 100})):
        box = only_box(write([video(track(*sequence, **more))]), 1, size)
        np.testing.assert_allclose(box, [0.2, 0.35, 0.2, 0.3], rtol=1e-6)
    with pytest.raises(ImportFailure, match="track 0: the size of the images is missing; --size says it"):
        only_box(write([video(track(*sequence))]))
    with pytest.raises(ImportFailure, match="the images are 200 x 100, but 100 x 200 by --size"):
        only_box(write([image("1.png")]), size=(100, 200))


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_a_byte_order_mark_is_no_part_of_the_text(read, tmp_path, encoding):
    assert read(image("größe_1.png"), image("größe_2.png"), encoding=encoding) == [[10, 10]]
    assert label_studio_files([tmp_path / "export.json"]) == [tmp_path / "export.json"]


def changed(task, change):
    change(task)
    return task


def result_of(task):
    return task["annotations"][0]["result"][0]


def still(**fields):
    """An image whose box has other values."""
    return changed(image("1.png"), lambda task: result_of(task)["value"].update(fields))


def moving(**fields):
    """A video whose track has other values."""
    return changed(video(track(key(1))), lambda task: result_of(task)["value"].update(fields))


REFUSED = {
    "JSON_MIN": ({"image": "1.png", "label": [], "annotator": 1}, "[0]: annotations is missing; allowed: a list"),
    "no task": ([1], "[0]: annotations is missing"),
    "no result": (image("1.png", {"id": 1}), "[0]: annotations: result is missing; allowed: a list"),
    "another shape": (image("1.png", annotation({"type": "polygonlabels"})), "type is 'polygonlabels'; allowed"),
    "no type": (image("1.png", annotation({})), "result[0]: type is missing; allowed: a str"),
    "both kinds": (image("1.png", annotation(rectangle(), track(key(1)))), "holds rectanglelabels and videorectangle"),
    "no value": (
        image("1.png", annotation({"type": "rectanglelabels", "original_width": 2, "original_height": 2})),
        "[0]: box 0: value is missing; allowed: a dict",
    ),
    "no data": (changed(image("1.png"), lambda task: task.pop("data")), "[0]: data is missing; allowed: a dict"),
    "another label": (still(rectanglelabels=["cat"]), "[0]: box 0: label 'cat'; allowed: goal_region"),
    "two labels": (still(rectanglelabels=["robot", "cat"]), "box 0: rectanglelabels holds 2 labels; allowed: one"),
    "no label": (still(rectanglelabels=None), "box 0: rectanglelabels is missing; allowed: a list"),
    "a text": (still(x="10"), "box 0: x is '10'; allowed: finite numbers"),
    "no width": (still(width=None), "box 0: width is None"),
    "no number": (still(y=float("nan")), "box 0: y is nan"),
    "a negative side": (still(width=-1), "the box is -2, 30 wide and high; allowed: sides of 0 or more"),
    "pixels": (still(x=1000), "box 0: the box (cx, cy, w, h) is 10.1, 0.35"),
    "no size": (changed(image("1.png"), lambda task: result_of(task).pop("original_width")), "original_width is None"),
    "size 0": (changed(image("1.png"), lambda task: result_of(task).update(original_width=0)), "images are 0 x 100"),
    "a turned image": (
        changed(image("1.png"), lambda task: result_of(task).update(image_rotation=90)),
        "image_rotation is 90; allowed: 0",
    ),
    "no frames": (moving(framesCount=None), "[0]: track 0: framesCount is None; allowed: finite numbers"),
    "half a frame": (moving(framesCount=2.5), "framesCount is 2.5; allowed: whole numbers from 1"),
    "no sequence": (moving(sequence=None), "track 0: sequence is missing; allowed: a list"),
    "frame 0": (moving(sequence=[key(0)]), "sequence[0]: frame is 0; allowed: whole numbers from 1 to 6"),
    "a frame after the end": (moving(sequence=[key(7)]), "frame is 7; allowed: whole numbers from 1 to 6"),
    "a frame twice": (moving(sequence=[key(2), key(2)]), "sequence[1]: the track has two boxes in this frame"),
    "no enabled": (moving(sequence=[key(1, enabled=None)]), "sequence[0]: enabled is missing; allowed: a bool"),
    "an enabled text": (moving(sequence=[key(1, enabled="true")]), "enabled is a str; allowed: a bool"),
    "a key frame that is a number": (moving(sequence=[1]), "sequence[0]: enabled is missing"),
    "a duration that is a text": (moving(duration="1 s"), "duration is '1 s'; allowed: finite numbers"),
    "another label in a video": (moving(labels=["cat"]), "track 0: label 'cat'; allowed: goal_region"),
    "far outside in a video": (moving(sequence=[key(3, x=500)]), "track 0: frame 3: the box (cx, cy, w, h) is 5.1"),
    "other numbers of frames": (video(track(key(1)), track(key(1), frames=7)), "framesCount is 6 and 7; allowed: one"),
}


@pytest.mark.parametrize("task, message", REFUSED.values(), ids=REFUSED)
def test_what_is_wrong_is_one_sentence_that_names_it(read, task, message):
    with pytest.raises(ImportFailure) as failure:
        read(task)
    assert message in str(failure.value) and "export.json: [0]" in str(failure.value)


def test_other_json_is_refused_or_left_out(tmp_path, capsys):
    texts = {"coco": '{"images": [], "annotations": []}', "min": ' [{"annotator": 1}]', "list": "[1]", "none": ""}
    texts |= {"tasks": '[{"annotations": [], "data": {"images": "1.png"}}]', "half": '[{"annotations": ['}
    for name, text in texts.items():
        (tmp_path / f"{name}.json").write_text(text)
    found = label_studio_files(sorted(tmp_path.iterdir()))
    assert [path.stem for path in found] == ["half", "min", "tasks"]
    assert "half.json: no JSON: JSONDecodeError" in refused(capsys, tmp_path / "half.json")
    assert "annotations is missing" in refused(capsys, tmp_path / "min.json")
    assert "holds no demonstrations" in refused(capsys, tmp_path / "tasks.json")
    forced = ("--format", "label_studio")
    assert "coco.json: holds a dict; allowed: a list of tasks" in refused(capsys, tmp_path / "coco.json", *forced)
