"""CVAT's XML: images and tracks come through to the pixel, and what is unclear is one sentence."""

import numpy as np
import pytest

from graphrl_jax.demonstrations import load
from graphrl_jax.perception.importers.cvat import cvat_files, read_cvat
from graphrl_jax.perception.importers.recording import ImportFailure
from tasks.match_regions.objects import OBJECTS
from tests.helpers.importing import refused, run

SQUARE = OBJECTS.class_names.index("green_square")
PIXELS = 'xtl="10.00" ytl="20.00" xbr="30.00" ybr="60.00"'
"""In an image of 100 x 200 pixels a box of (0.2, 0.2, 0.2, 0.2)."""


def xml(body, meta=""):
    return (
        f'<?xml version="1.0" encoding="utf-8"?>\n<annotations>\n<version>1.1</version>\n{meta}{body}</annotations>\n'
    )


def image(name, boxes=f'<box label="green_square" source="manual" occluded="0" {PIXELS} z_order="0">\n</box>', **more):
    attributes = {"id": 0, "name": name, "width": 100, "height": 200} | more
    written = " ".join(f'{key}="{value}"' for key, value in attributes.items())
    return f"<image {written}>{boxes}</image>\n"


def task(size=6, sides="<original_size><width>100</width><height>200</height></original_size>", **more):
    fields = {"id": 3, "name": "pick", "size": size, "mode": "interpolation", "start_frame": 0, "frame_filter": ""}
    fields |= more
    return f"<task>{''.join(f'<{key}>{value}</{key}>' for key, value in fields.items())}{sides}</task>"


def box(frame, x=10, outside=0, keyframe=1, more=""):
    """A box of 20 x 40 pixels at (x, 20)."""
    corners = f'xtl="{x:.2f}" ytl="20.00" xbr="{x + 20:.2f}" ybr="60.00"'
    attribute = '<attribute name="held">false</attribute>'
    return (
        f'<box frame="{frame}" keyframe="{keyframe}" outside="{outside}" occluded="0" {corners} z_order="0" {more}>'
        f"{attribute}</box>\n"
    )


def track(*boxes, label="green_square", more=""):
    return f'<track id="0" label="{label}" source="manual" {more}>{"".join(boxes)}</track>\n'


def video(*tracks, meta=None):
    return xml("".join(tracks), f"<meta>{task() if meta is None else meta}<dumped>today</dumped></meta>\n")


@pytest.fixture
def read(tmp_path):
    """The recordings of a file with this content: x of the left edge in pixels, per frame, None where it is absent."""

    def read(text, encoding="utf-8", size=None):
        path = tmp_path / "annotations.xml"
        path.write_text(text, encoding)
        recordings = list(read_cvat([path], OBJECTS.class_names, size))
        frames = [frame for one in recordings for frame in one.detections]
        assert all(len(frame) <= 1 and all(found.class_id == SQUARE for found in frame) for frame in frames)
        lefts = [
            [float(f[0].box[0] - f[0].box[2] / 2) * 100 if f else None for f in one.detections] for one in recordings
        ]
        return [[None if left is None else round(left, 2) for left in one] for one in lefts]

    return read


def test_boxes_on_images(tmp_path):
    path = tmp_path / "annotations.XML"
    path.write_text(xml(image("demo/frame_10.png", "") + image("demo/frame_9.png")))
    run(path, "--out", tmp_path / "demos.npz")
    demos = load(tmp_path / "demos.npz")
    slot = OBJECTS.names.index("square")
    np.testing.assert_array_equal(demos.mask[0, :, slot], [True, False])
    np.testing.assert_allclose(demos.boxes[0, 0, slot], [0.2, 0.2, 0.2, 0.2], rtol=1e-6)


def test_a_turned_box_is_enclosed(tmp_path):
    """20 x 40 pixels about (20, 40), turned by a quarter, are 40 x 20 pixels."""
    path = tmp_path / "annotations.xml"
    turned = f'<box label="green_square" occluded="0" {PIXELS} rotation="90.00" z_order="0"></box>'
    path.write_text(xml(image("1.png", turned)))
    ((frame,),) = [one.detections for one in read_cvat([path], OBJECTS.class_names)]
    np.testing.assert_allclose(frame[0].box, [0.2, 0.2, 0.4, 0.1], rtol=1e-6)
    path.write_text(video(track(box(0, more='rotation="350"'), box(2, more='rotation="10"'))))
    ((_, middle, *_),) = [one.detections for one in read_cvat([path], OBJECTS.class_names)]
    np.testing.assert_allclose(middle[0].box, [0.2, 0.2, 0.2, 0.2], rtol=1e-6)


def test_images_are_recordings_by_task_and_folder(read):
    names = ["a\\2.png", "a\\1.png", "b\\1.png", "b\\2.png"]
    assert read(xml("".join(map(image, names)))) == [[10, 10]] * 2
    same = [image(f"frame_{number:06d}", task_id=number // 10) for number in (10, 11, 0, 1, 3)]
    assert read(xml("".join(same))) == [[10, 10, None, 10], [10, 10]]
    stepped = [image(f"frame_{number:06d}") for number in (0, 5, 15)]
    assert read(xml("".join(stepped))) == [[10, 10, None, 10]]


def test_a_track_as_it_is_exported(read):
    """Every visible frame is listed; a box that is outside ends a span one frame later."""
    boxes = [box(1, 10), box(2, 12, keyframe=0), box(3, 14), box(4, 14, outside=1), box(5, 30)]
    assert read(video(track(*boxes))) == [[None, 10, 12, 14, None, 30]]
    assert read(video(track(*reversed(boxes)))) == [[None, 10, 12, 14, None, 30]]


def test_boxes_between_key_frames_and_after_the_last_one(read):
    assert read(video(track(box(0, 10), box(4, 20)))) == [[10, 12.5, 15, 17.5, 20, 20]]
    assert read(video(track(box(2, 10), box(4, 10, outside=1)))) == [[None, None, 10, 10, None, None]]
    assert read(video(track(box(5, 10), box(6, 10, outside=1)))) == [[None] * 5 + [10]]


def test_frames_are_those_of_the_task(read):
    meta = task(size=4, start_frame=10, stop_frame=25, frame_filter="step=5")
    boxes = [box(10, 10), box(20, 14), box(25, 14, outside=1)]
    assert read(video(track(*boxes), meta=meta)) == [[10, 12, 14, None]]
    job = meta.replace("task>", "job>")
    assert read(video(track(*boxes), meta=job)) == [[10, 12, 14, None]]
    with pytest.raises(ImportFailure, match="track 0: frame is 12; allowed: 10 to 25 in steps of 5, the task's frames"):
        read(video(track(box(12)), meta=meta))


def test_frames_of_a_project_are_counted_on_through_its_tasks(read):
    """Within a subset; the second task's frames follow the start and the frames of the first."""
    tasks = [
        task(2, id=3, subset="train", start_frame=1),
        task(2, id=5, subset="train", frame_filter="step=2"),
        task(1, id=4, subset="val"),
    ]
    meta = f"<project><name>p</name><tasks>{''.join(tasks)}</tasks></project>"
    tracks = [
        track(box(3, 30), box(5, 40), more='task_id="5" subset="train"'),
        track(box(1, 10), box(2, 20), more='task_id="3" subset="train"'),
        track(box(0, 50), more='task_id="4" subset="val"'),
    ]
    assert read(video(*tracks, meta=meta)) == [[10, 20], [30, 40], [50]]
    with pytest.raises(ImportFailure, match="track 0: task_id is '9'; allowed: 3, 5, 4"):
        read(video(track(box(0), more='task_id="9"'), meta=meta))
    with pytest.raises(ImportFailure, match="task 3 is listed twice"):
        read(video(meta=f"<project><tasks>{task() * 2}</tasks></project>"))


def test_the_size_of_images_is_the_files_or_the_users(read, tmp_path, capsys):
    text = video(track(box(0)), meta=task(1, sides=""))
    assert read(text, size=(100, 200)) == [[10]]
    path = tmp_path / "annotations.xml"
    assert "annotations.xml: the size of the images is missing; --size says it" in refused(capsys, path)
    run(path, "--out", tmp_path / "demos.npz", "--size", 100, 200)
    sides = "<original_size><width>100</width><height>200</height></original_size>"
    assert read(xml(track(box(0)), f"<meta>{task(1, sides='')}{sides}</meta>")) == [[10]]
    for written in (video(track(box(0))), xml(image("1.png"))):
        with pytest.raises(ImportFailure, match="the images are 100 x 200, but 20 x 20 by --size"):
            read(written, size=(20, 20))


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_a_byte_order_mark_is_no_part_of_the_text(read, encoding, tmp_path):
    assert read(xml(image("größe_1.png") + image("größe_2.png")), encoding) == [[10, 10]]
    assert cvat_files([tmp_path / "annotations.xml"]) == [tmp_path / "annotations.xml"]


REFUSED = {
    "an empty file": ("", "no XML: no element found"),
    "half a file": (xml("")[:60], "no XML"),
    "an entity": ('<!DOCTYPE a [<!ENTITY b "c">]>' + xml("")[39:], "declares a document type or an entity; allowed"),
    "another root": ("<annotation/>", "holds 'annotation' of version '1.1'; allowed: CVAT's 'annotations' of 1.1"),
    "another version": (xml("").replace("1.1", "1.0"), "of version '1.0'"),
    "no meta": (xml(track(box(0))), "meta holds no task, job or project; allowed: one of them"),
    "images and tracks": (video(track(), image("1.png")), "holds images and tracks; allowed: one of both"),
    "an image twice": (xml(image("1.png") * 2), "1.png is listed twice"),
    "names without numbers": (xml(image("a.png") + image("b.png")), "a.png: the name holds no frame number"),
    "another shape": (
        xml(image("1.png", '<polygon label="a"/>')),
        "image '1.png': holds a shape 'polygon'; allowed: box",
    ),
    "another label": (
        xml(image("1.png").replace("green_square", "cat")),
        "image '1.png': box 0: label 'cat'; allowed: goal_",
    ),
    "no label": (video(track(box(0)).replace("label", "name")), "track 0: label None; allowed: goal_region"),
    "no width": (xml(image("1.png").replace("width", "w")), "image '1.png': width is missing; allowed: finite numbers"),
    "no height": (xml(image("1.png", height=0)), "image '1.png': the images are 100 x 0; allowed: sides above 0"),
    "a word": (
        xml(image("1.png").replace("30.00", "left")),
        "image '1.png': box 0: xbr is 'left'; allowed: finite numbers",
    ),
    "no number": (xml(image("1.png").replace("30.00", "nan")), "xbr is 'nan'"),
    "corners swapped": (
        xml(image("1.png").replace("30.00", "5")),
        "the box is -5, 40 wide and high; allowed: sides of 0",
    ),
    "far outside": (xml(image("1.png").replace("30.00", "900")), "the box (cx, cy, w, h) is 4.55"),
    "no frame": (video(track(box("").replace("frame=", "f="))), "track 0: frame is missing; allowed: finite numbers"),
    "half a frame": (video(track(box(1.5))), "track 0: frame is 1.5; allowed: whole numbers from 0"),
    "a frame after the end": (video(track(box(6))), "track 0: frame is 6; allowed: 0 to 5, the task's frames"),
    "a frame twice": (video(track(box(1), box(1))), "track 0: frame 1: the track has two boxes in this frame"),
    "no outside": (video(track(box(1).replace("outside", "o"))), "track 0: frame 1: outside is None; allowed: 0, 1"),
    "no size": (video(meta="<task></task>"), "meta: size is missing"),
    "no frames": (video(meta=task(0)), "meta: size is 0; allowed: whole numbers from 1 to 500000"),
    "far too long": (video(meta=task(10**9)), "meta: size is 1000000000; allowed"),
    "half an original size": (video(meta=task(sides="<original_size/>")), "meta: width of original_size is missing"),
}


@pytest.mark.parametrize("text, message", REFUSED.values(), ids=REFUSED)
def test_what_is_wrong_is_one_sentence_that_names_it(read, text, message):
    with pytest.raises(ImportFailure) as failure:
        read(text)
    assert message in str(failure.value) and "annotations.xml" in str(failure.value)
    assert "\n" not in str(failure.value)


def test_a_task_without_boxes_is_refused(tmp_path, capsys):
    path = tmp_path / "annotations.xml"
    path.write_text(video())
    assert "none of the objects goal_region" in refused(capsys, path)


def test_other_xml_is_left_out(tmp_path):
    (tmp_path / "voc.xml").write_text("<annotation><folder>annotations</folder></annotation>")
    (tmp_path / "task.xml").write_text(xml(""))
    assert cvat_files(sorted(tmp_path.iterdir())) == [tmp_path / "task.xml"]
