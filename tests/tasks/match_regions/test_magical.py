"""MAGICAL's controls and looks."""

import jax
import numpy as np

from tasks.match_regions import magical


def test_magicals_actions_by_number():
    actions = np.asarray(jax.vmap(magical.action)(np.arange(magical.NUM_ACTIONS)))
    assert len(np.unique(actions, axis=0)) == 18
    np.testing.assert_array_equal(actions[[0, 1, 2, 3, 6, 9, 13]], [
        [0, 0, 1], [1, 0, 1], [-1, 0, 1], [0, 1, 1], [0, -1, 1], [0, 0, -1], [1, 1, -1],
    ])  # fmt: skip
