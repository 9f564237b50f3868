"""Scenes on which a learned reward is audited."""

import jax
import numpy as np

from tests.helpers.match_regions import TASK


def test_edge_scenes_differ_in_one_target_that_crosses_the_border() -> None:
    scenes = TASK.landscape(jax.random.key(0))
    inside, outside = scenes.within.boxes, scenes.beside.boxes
    region = inside[0, 0]
    reach = region[2:] / 2
    within, beside = ((np.abs(boxes[:, 2:4, :2] - region[:2]) <= reach).all(-1) for boxes in (inside, outside))
    assert within.all() and (beside.sum(1) == 1).all() and 0.3 < beside[:, 0].mean() < 0.7
    np.testing.assert_array_equal(inside[:, 4:], outside[:, 4:])
    active = scenes.within.active
    np.testing.assert_array_equal(active, scenes.beside.active)
    assert not active[:, [0, 7]].any() and active[:, 1:4].all()
    assert 0.3 < active[:, 4:7].mean() < 0.7
    # The robot stands outside and reaches in: it touches the target that crosses, and faces the region.
    gap = np.linalg.norm(outside[:, 1, :2] - outside[:, 2:4, :2][~beside], axis=-1)
    assert gap.max() < 0.25
