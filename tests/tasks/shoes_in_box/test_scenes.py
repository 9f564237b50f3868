"""Scenes on which a learned reward is audited."""

import jax
import numpy as np

from tests.helpers.shoes_in_box import TASK


def test_the_landscapes_scenes_are_what_they_say():
    found = TASK.landscape(jax.random.key(0))
    assert len(found.grids) == 4 and all(grid.inside.any() and not grid.inside.all() for grid in found.grids)
    assert np.ptp(found.random_distance) > 0.5 and np.isfinite(found.random.boxes).all()
    for scenes in (found.finished, found.unfinished, found.within, found.beside):
        boxes = scenes.boxes
        assert np.all((boxes[..., 2:] > 0) & (boxes[..., :2] > -0.5) & (boxes[..., :2] < 1.5))
