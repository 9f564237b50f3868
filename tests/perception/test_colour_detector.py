"""Colours and shapes are found where they were drawn."""

import imageio.v3 as imageio
import numpy as np
import pytest

from graphrl_jax.perception.colour_detector import ColourDetector, Look
from graphrl_jax.viz.video import write_video
from tasks.match_regions import geometry, magical
from tasks.match_regions.layouts import demo_world
from tests.helpers.drawings import SCENE, draw

POSES = np.array([[*place, angle] for _, _, place, angle in SCENE.values()], np.float32)
_DEMO = demo_world()
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
