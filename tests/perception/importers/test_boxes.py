"""Boxes are finite, in or near the image, and what is not is named."""

import numpy as np
import pytest

from graphrl_jax.perception.importers.boxes import box_of_points, checked_box, checked_confidence
from graphrl_jax.perception.importers.recording import ImportFailure


def test_a_box_goes_around_points():
    box = box_of_points([0.1, 0.5, 0.3, 0.2, 0.2, 0.6], "line 1")
    np.testing.assert_allclose(box, [0.2, 0.4, 0.2, 0.4], rtol=1e-6)
    assert box.dtype == np.float32


@pytest.mark.parametrize(
    "box", [[0.5, 0.5, 0, 0], [0, 1, 1, 1], [-0.4, 0.5, 0.2, 0.1], [0.5, 0.5, 2, 2]], ids=lambda box: str(box)
)
def test_boxes_may_leave_the_image_a_little(box):
    np.testing.assert_allclose(checked_box(np.array(box), "line 1"), box, rtol=1e-6)


@pytest.mark.parametrize(
    "box", [[0.5, 0.5, -0.1, 0], [1.4, 0.5, 0.3, 0], [64, 64, 8, 8], [np.nan, 0, 0, 0], [0, 0, np.inf, 0]]
)
def test_other_boxes_are_refused(box):
    with pytest.raises(ImportFailure, match=r"line 1: the box \(cx, cy, w, h\) is .*; allowed: edges from -0.5 to 1.5"):
        checked_box(np.array(box), "line 1")


def test_a_confidence_is_from_0_to_1():
    assert checked_confidence(1.0, "score") == 1.0
    for value in (-0.1, 7.0, np.nan):
        with pytest.raises(ImportFailure, match="score is .*; allowed: a confidence from 0 to 1"):
            checked_confidence(value, "score")
