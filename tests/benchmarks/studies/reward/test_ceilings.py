"""Ideal values, by hand."""

import numpy as np

from benchmarks.studies.reward import ceilings


def test_ideal_values_count_both_targets_and_the_robots_way():
    boxes = np.zeros((4, 4, 4))
    boxes[:, 0] = [0.5, 0.5, 0.2, 0.2]
    boxes[:, 1, 0] = [0.1, 0.3, 0.5, 0.7]  # the robot brings the first target, walks to the second, brings it
    boxes[:, 2, 0] = [0.3, 0.3, 0.5, 0.5]
    boxes[:, 3, 0] = [0.9, 0.9, 0.9, 0.6]
    np.testing.assert_allclose(ceilings.way_to_go(boxes, 0.0), [0.5, 0.5, 0.3, 0.0])
    np.testing.assert_allclose(ceilings.way_to_go(boxes, 0.5), [0.8, 0.7, 0.5, 0.05])
    found = ceilings.distances(boxes[:1, :, :])
    reach = np.hypot(0.2, 0.5) + np.hypot(0.4, 0.5)
    np.testing.assert_allclose(found["centre"], reach)
    np.testing.assert_allclose(found["nearest"], np.hypot(0.1, 0.4) + np.hypot(0.3, 0.4))
