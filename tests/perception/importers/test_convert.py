"""Formats are told by names, and what was never seen is no demonstration."""

import imageio.v3 as imageio
import numpy as np
import pytest

from graphrl_jax.perception.config import FORMATS, SIZED_FORMATS
from graphrl_jax.perception.detector import Detection, NoDetector
from graphrl_jax.perception.importers.convert import (
    ENDINGS,
    Source,
    demonstrations_of,
    guess_format,
    track_recording,
)
from graphrl_jax.perception.importers.recording import ImportFailure, Recording
from tasks.match_regions.objects import OBJECTS as match_regions
from tests.helpers.graphs import OBJECTS
from tests.helpers.importing import refused


def test_nothing_seen_is_nothing_written(tmp_path, capsys):
    imageio.imwrite(tmp_path / "0.png", np.full((64, 64, 3), 128, np.uint8))
    assert "none of the objects goal_region" in refused(capsys, tmp_path)


def test_formats_are_told_by_names(tmp_path):
    for name, expected in (
        ("a.pkl.gz", "magical"),
        ("a.GIF", "video"),
        ("a.jpg", "frames"),
        ("a.txt", "yolo"),
        ("GT.TXT", "mot"),
    ):
        folder = tmp_path / expected
        folder.mkdir()
        (folder / name).touch()
        assert guess_format(folder) == guess_format(folder / name) == expected
    for name, expected in (("a.json", "coco"), ("a.XML", "cvat"), ("a.png", "frames"), ("classes.txt", "yolo")):
        (tmp_path / name).touch()
        assert guess_format(tmp_path / name) == expected
    (tmp_path / "nothing").mkdir()
    with pytest.raises(ImportFailure, match="nothing is empty"):
        guess_format(tmp_path / "nothing")
    (tmp_path / "nothing" / "notes.md").touch()
    with pytest.raises(ImportFailure, match="known formats"):
        guess_format(tmp_path / "nothing")


def test_a_demonstration_file_is_no_recording(tmp_path, capsys):
    (tmp_path / "demos.npz").touch()
    assert "demos.npz is a demonstration file; allowed: recordings" in refused(capsys, tmp_path / "demos.npz")


@pytest.mark.parametrize(
    "files, expected",
    [
        ({"images/0.png": "", "labels/0.txt": ""}, "yolo"),
        ({"take.mp4": "", "labels/take_1.txt": ""}, "yolo"),
        ({"0.png": "", "boxes.json": '{"images": [], "annotations": []}'}, "coco"),
        ({"0.png": "", "tasks.json": '[{"annotations": [], "data": {"images": "0.png"}}]'}, "label_studio"),
        ({"images/0.png": "", "annotations.XML": "<annotations/>", "voc.xml": "<annotation/>"}, "cvat"),
        ({"img1/1.jpg": "", "gt/gt.txt": "1,1,1,1,9,9,1,1,1", "gt/labels.txt": "robot", "seqinfo.ini": ""}, "mot"),
        ({"take.mp4": "", "MOT16-02.txt": "1,1,1,1,9,9,1,-1,-1,-1"}, "mot"),
        ({"labels/1.txt": "3,0.1,0.2,0.3,0.2,0.3,0.4,0.1,0.4"}, "yolo"),
        ({"0.png": "", "voc.xml": "<annotation/>"}, "frames"),
        (
            {"0.png": "", "notes.json": '{"info": {}}', "classes.txt": "a", "README.txt": "read", "data.yaml": ""},
            "frames",
        ),
        ({"0.png": "", "Thumbs.db": "", ".hidden.mp4": "", "desktop.ini": ""}, "frames"),
    ],
)
def test_labels_beside_images_are_used_and_other_files_left_out(tmp_path, files, expected):
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    assert guess_format(tmp_path) == expected


@pytest.mark.parametrize(
    "names, says",
    [
        (["0.png", "take.mp4"], "video and frames"),
        (["0.txt", "boxes.json"], "coco and yolo"),
        (["0.txt", "gt.txt"], "yolo and mot"),
        (["boxes.json", "tasks.json", "a.xml"], "coco and cvat and label_studio"),
    ],
)
def test_several_formats_need_a_choice(tmp_path, names, says):
    texts = {"boxes.json": '{"images": [], "annotations": []}', "tasks.json": '[{"annotations": []}]'}
    texts["a.xml"] = "<annotations/>"
    for name in names:
        (tmp_path / name).write_text(texts.get(name, ""))
    with pytest.raises(ImportFailure, match=f"holds {says}; --format says which to read"):
        guess_format(tmp_path)


def test_masks_are_told_by_their_folder_or_need_a_choice(tmp_path, capsys):
    values = np.zeros((8, 8), np.uint8)
    values[2:4, 2:4] = 4
    (tmp_path / "pick").mkdir()
    imageio.imwrite(tmp_path / "pick" / "0.png", values)
    says = "pick/0.png may be a frame or a mask; --format frames or --format masks says which"
    assert says in refused(capsys, tmp_path) and says in refused(capsys, tmp_path / "pick" / "0.png")
    (recording,) = Source(tmp_path, "masks").recordings(match_regions)
    assert recording.frames is None and recording.detections[0][0].class_id == match_regions.class_ids[3]
    (tmp_path / "pick" / "0.txt").write_text("3 0.5 0.5 0.1 0.1")
    assert guess_format(tmp_path) == "yolo"
    (tmp_path / "pick" / "0.txt").unlink()
    (tmp_path / "pick").rename(tmp_path / "Masks")
    assert guess_format(tmp_path) == guess_format(tmp_path / "Masks" / "0.png") == "masks"
    imageio.imwrite(tmp_path / "0.png", np.full((8, 8, 3), 128, np.uint8))
    assert guess_format(tmp_path) == "masks"
    (recording,) = Source(tmp_path, "masks").recordings(match_regions)
    assert recording.detections is not None
    (recording,) = Source(tmp_path, "frames").recordings(match_regions)
    assert recording.source == tmp_path and recording.frames.min() == 128
    (tmp_path / "0.txt").write_text("3 0.5 0.5 0.1 0.1")
    with pytest.raises(ImportFailure, match="yolo and masks; --format says which to read"):
        guess_format(tmp_path)


def test_grey_frames_are_no_masks(tmp_path):
    (tmp_path / "masks").mkdir()
    imageio.imwrite(tmp_path / "masks" / "0.png", np.arange(64, dtype=np.uint8).reshape(8, 8) + 100)
    assert guess_format(tmp_path) == "frames"


def test_a_text_of_one_format_is_no_text_of_another(tmp_path):
    (tmp_path / "1.txt").write_text("3 0.5 0.5 0.1 0.1")
    (tmp_path / "tracks_1.txt").write_text("1,1,11,21,20,40,1,4,1")
    (tmp_path / "labels.txt").write_text("robot\ncat\ncat\nrobot")
    assert len(list(Source(tmp_path, "mot", (100, 100)).recordings(match_regions))) == 1
    (tmp_path / "labels.txt").unlink()
    (recording,) = Source(tmp_path, "yolo").recordings(match_regions)
    assert [len(frame) for frame in recording.detections] == [1]


def test_every_format_has_its_endings():
    assert tuple(ENDINGS) == FORMATS and set(SIZED_FORMATS) < set(FORMATS)


def test_what_a_source_lacks_is_said(tmp_path):
    with pytest.raises(ImportFailure, match="nowhere is missing"):
        Source(tmp_path / "nowhere")
    with pytest.raises(ImportFailure, match="unknown format 'avi'; known formats: magical, video"):
        Source(tmp_path, "avi")
    with pytest.raises(ImportFailure, match="the size of the images is missing"):
        Source(tmp_path, "corners")
    with pytest.raises(ImportFailure, match="the size of the images is 0 x 10; allowed: 1 x 1 or more"):
        Source(tmp_path, "corners", (0, 10))


def test_a_recording_is_seen_by_a_detector_unless_it_has_detections(tmp_path):
    def seen(x: float) -> list[Detection]:
        return [Detection(1, np.array([x, 0.5, 0.1, 0.1], np.float32))]

    class Eye:
        def detect(self, frame):
            return seen(frame[0, 0, 0] / 100)

    ready = Recording(tmp_path, detections=[seen(0.2), seen(0.3)])
    film = Recording(tmp_path, frames=np.stack([np.full((2, 2, 3), grey, np.uint8) for grey in (20, 30)]))
    none = NoDetector("nothing finds them")
    for recording, detector in ((ready, none), (film, Eye())):
        boxes, mask, _ = track_recording(recording, OBJECTS, detector)
        np.testing.assert_allclose(boxes[:, 1, 0], [0.2, 0.3])
        np.testing.assert_array_equal(mask, [[False, True, False, False]] * 2)
    for recording, says in (
        (Recording(tmp_path), "no frames"),
        (Recording(tmp_path, detections=[]), "no frames"),
        (Recording(tmp_path, detections=[[], []]), "none of the objects robot, block, region, absent was seen"),
    ):
        with pytest.raises(ImportFailure, match=says):
            track_recording(recording, OBJECTS, none)
    with pytest.raises(ValueError, match="^nothing finds them$"):
        track_recording(film, OBJECTS, none)


def test_notes_tell_what_tracking_did(tmp_path):
    def seen(*places: float) -> list[Detection]:
        return [Detection(1, np.array([x, 0.5, 0.1, 0.1], np.float32)) for x in places]

    none = NoDetector("nothing finds them")
    _, _, notes = track_recording(Recording(tmp_path, detections=[seen(0.2, 0.5, 0.9), [], seen(0.3)]), OBJECTS, none)
    assert notes == ("boxes bridged over gaps: 1", "boxes dropped for want of a slot: 1")
    assert track_recording(Recording(tmp_path, detections=[seen(0.2)]), OBJECTS, none)[2] == ()


def test_tracks_are_padded_to_the_longest():
    tracks = [(np.full((frames, 4, 4), 0.1, np.float32), np.ones((frames, 4), bool), frames > 2) for frames in (2, 3)]
    demos = demonstrations_of(tracks, OBJECTS, 8.0, "carry", "here")
    np.testing.assert_array_equal(demos.lengths, [2, 3])
    np.testing.assert_array_equal(demos.success, [False, True])
    assert demos.boxes.shape == (2, 3, 4, 4) and not demos.mask[0, 2].any() and demos.mask[1].all()
    assert (demos.frame_rate, demos.task, demos.source) == (8.0, "carry", "here")
    assert demos.events is None and demos.event_names == ()
    with pytest.raises(ImportFailure, match="here holds no demonstrations"):
        demonstrations_of([], OBJECTS, 8.0, "carry", "here")


def test_events_are_those_of_all_demonstrations():
    tracks = [(np.full((5, 4, 4), 0.1, np.float32), np.ones((5, 4), bool), True)] * 2
    demos = demonstrations_of(tracks, OBJECTS, 8.0, "carry", "here", [{"a": 2, "b": 4}, {"b": 1, "c": 3}])
    assert demos.event_names == ("a", "b", "c")
    np.testing.assert_array_equal(demos.events, [[2, 4, -1], [-1, 1, 3]])
    for events in ([{"a": 2}, None], [None, None], [{}, {}], [{"a": 2}]):
        assert demonstrations_of(tracks, OBJECTS, 8.0, "carry", "here", events).events is None
