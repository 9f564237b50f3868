"""Colours and shapes are found where they were drawn, and trained models are asked in their own language."""

from types import SimpleNamespace

import imageio.v3 as imageio
import numpy as np
import pytest
from pictures import SCENE, draw

from graphrl_jax.detection import ColourDetector, Look, ModelDetector, ultralytics
from graphrl_jax.video import write_video
from tasks.match_regions import geometry, magical
from tasks.match_regions.layouts import demo_scene
from tasks.match_regions.objects import OBJECTS

POSES = np.array([[*place, angle] for _, _, place, angle in SCENE.values()], np.float32)
_DEMO = demo_scene()
TRUE = np.concatenate([[geometry.region_box(_DEMO.region)], geometry.block_boxes(POSES, _DEMO.shapes)])
CLASSES = (0, 2, 3, 4, 5, 6)


def found(frame):
    return {detection.class_id: detection.box for detection in magical.detector().detect(frame)}


@pytest.mark.parametrize("size", [256, 384, 512])
def test_every_object_is_found_where_it_was_drawn(size):
    boxes = found(draw(size))
    assert set(boxes) == {0, 1, 2, 3, 4, 5, 6}
    np.testing.assert_allclose([boxes[k] for k in CLASSES], TRUE, atol=1.6 / size + 0.004)
    np.testing.assert_allclose(boxes[1] * 2.04 - [1.02, 1.02, 0, 0], [-0.5, -0.1, 0.4, 0.4], atol=0.02)


def test_touching_objects_of_one_colour_stay_two():
    boxes = found(draw(moved={"star": (0.4, 0.3), "square": (0.4, 0.53)}))
    shift = np.array([0.4, -0.3]) / 2.04 + 0.5
    np.testing.assert_allclose(boxes[2][:2], shift, atol=0.02)
    assert boxes[3][1] < boxes[2][1] and abs(boxes[3][3] - TRUE[2][3]) < 0.02


def test_what_is_not_there_is_not_found():
    assert set(found(draw(without=("square", "blue_pentagon")))) == {0, 1, 2, 5, 6}
    assert magical.detector().detect(np.full((64, 64, 3), 255, np.uint8)) == []


def test_classes_of_one_colour_need_a_shape():
    with pytest.raises(ValueError, match=r"classes \[0, 1\] share the colours .* reach is missing"):
        ColourDetector([Look(0, ((1, 2, 3),), reach=1.0), Look(1, ((1, 2, 3),))])
    with pytest.raises(ValueError, match=r"the colour \(1, 2, 3\) belongs to two looks"):
        ColourDetector([Look(0, ((1, 2, 3),)), Look(1, ((1, 2, 3), (9, 9, 9)))])


@pytest.mark.parametrize("kind", ["mp4", "jpg"])
def test_compression_changes_little(tmp_path, kind):
    path = tmp_path / f"scene.{kind}"
    if kind == "mp4":
        write_video(np.stack([draw()] * 3), path, 8.0)
        frame = imageio.imread(path, index=1)
    else:
        imageio.imwrite(path, draw(), quality=90)
        frame = imageio.imread(path)
    boxes = found(np.asarray(frame))
    assert set(boxes) == {0, 1, 2, 3, 4, 5, 6}
    np.testing.assert_allclose([boxes[k] for k in CLASSES], TRUE, atol=0.02)


FRAME = np.zeros((100, 200, 3), np.uint8)


def test_a_model_with_ultralytics_interface():
    boxes = SimpleNamespace(
        xywhn=np.array([[0.5, 0.5, 0.1, 0.2], [0.2, 0.2, 0.1, 0.1], [0.1, 0.1, 0.1, 0.1]]),
        cls=np.array([7.0, 7.0, 3.0]),
        conf=np.array([0.9, 0.2, 0.9]),
    )

    def model(frame):
        assert frame is FRAME
        return [SimpleNamespace(boxes=boxes)]

    model.names = {3: "cat", 7: "shoe"}
    (detection,) = ModelDetector(model, ("box", "shoe")).detect(FRAME)
    assert detection.class_id == 1
    np.testing.assert_allclose(detection.box, [0.5, 0.5, 0.1, 0.2])
    with pytest.raises(ValueError, match=r"the model knows \['cat', 'shoe'\], but the task has \('robot',\)"):
        ModelDetector(model, ("robot",))


def test_a_model_with_torchvisions_interface():
    result = {"boxes": np.array([[20.0, 10.0, 60.0, 30.0]]), "labels": np.array([1]), "scores": np.array([0.8])}
    detector = ModelDetector(lambda image: [result], ("box", "shoe"), names={1: "box"}, prepare=lambda frame: [frame])
    (detection,) = detector.detect(FRAME)
    assert detection.class_id == 0
    np.testing.assert_allclose(detection.box, [0.2, 0.2, 0.2, 0.2])


def test_ultralytics_is_asked_for_by_name(tmp_path):
    try:
        import ultralytics as _  # noqa: F401
    except ImportError:
        with pytest.raises(ValueError, match="need the package ultralytics"):
            ultralytics(tmp_path / "weights.pt", OBJECTS)
    else:
        pytest.skip("ultralytics is installed")
