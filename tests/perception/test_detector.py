"""Boxes by hand."""

import numpy as np

from graphrl_jax.perception.detector import box_of_corners


def test_a_box_is_its_centre_and_its_extent():
    box = box_of_corners(np.array([10, 20, 40, 30]))
    assert box.dtype == np.float32
    np.testing.assert_array_equal(box, [25, 25, 30, 10])
