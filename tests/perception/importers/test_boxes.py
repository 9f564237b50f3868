"""Boxes are finite, in or near the image, and what is not is named."""

import numpy as np
import pytest

from graphrl_jax.perception.importers.boxes import (
    box_of_points,
    checked_box,
    checked_confidence,
    image_size,
    turned_box,
)
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


@pytest.mark.parametrize(
    "turn, pivot, corners",
    [
        (0, (0.5, 0.5), (20, 10, 60, 30)),
        (90, (0.5, 0.5), (30, 0, 50, 40)),
        (-90, (0.5, 0.5), (30, 0, 50, 40)),
        (180, (0, 0), (-20, -10, 20, 10)),
        (90, (0, 0), (0, 10, 20, 50)),
        (-90, (0, 0), (20, -30, 40, 10)),
    ],
)
def test_a_box_goes_around_a_turned_one(turn, pivot, corners):
    """40 x 20 pixels at (20, 10) in an image of 200 x 100; a quarter clockwise takes right to down."""
    x0, y0, x1, y1 = corners
    expected = [(x0 + x1) / 400, (y0 + y1) / 200, (x1 - x0) / 200, (y1 - y0) / 100]
    box = turned_box(np.array([20, 10, 40, 20, turn]), pivot, (200, 100), "line 1")
    np.testing.assert_allclose(box, expected, atol=1e-6)


def test_a_turn_is_one_of_pixels_and_not_of_shares():
    """A square of side 20 on its tip is 20 sqrt(2) wide and high, in an image of any shape."""
    box = turned_box(np.array([40, 40, 20, 20, 45]), (0.5, 0.5), (200, 100), "line 1")
    np.testing.assert_allclose(box, [0.25, 0.5, 20 * 2**0.5 / 200, 20 * 2**0.5 / 100], rtol=1e-6)
    with pytest.raises(ImportFailure, match="line 1: the box is 20, -1 wide and high; allowed: sides of 0 or more"):
        turned_box(np.array([40, 40, 20, -1, 90]), (0.5, 0.5), (200, 100), "line 1")


def test_the_size_of_images_is_the_files_or_the_users():
    for own, asked in (((200, 100), None), (None, (200, 100)), ([200.0, 100.0], (200, 100))):
        np.testing.assert_array_equal(image_size(own, asked, "gt.txt"), [200, 100])
    for own, asked, says in (
        (None, None, "gt.txt: the size of the images is missing; --size says it"),
        ((200, 100), (100, 200), "gt.txt: the images are 200 x 100, but 100 x 200 by --size"),
        ((0, 100), None, "gt.txt: the images are 0 x 100; allowed: sides above 0"),
    ):
        with pytest.raises(ImportFailure, match=says):
            image_size(own, asked, "gt.txt")
