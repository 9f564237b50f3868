"""Where episodes start."""

import math

import jax
import numpy as np

from tasks.shoes_in_box import layouts
from tests.helpers.shoes_in_box import TASK


def test_starts_are_randomised_as_in_rlbench():
    qpos, boxes = jax.vmap(TASK.layout.sample)(jax.random.split(jax.random.key(0), 256))
    assert np.all(np.abs(boxes[:, 2]) <= math.pi / 8) and np.std(boxes[:, 2]) > 0.15
    shoes = np.asarray(qpos[:, 10:]).reshape(-1, 2, 7)
    assert np.all(np.abs(shoes[..., :2] - layouts.SHOE_STARTS[:, :2]) <= 0.03 + 1e-6)
    np.testing.assert_allclose(np.linalg.norm(shoes[..., 3:], axis=-1), 1.0, atol=1e-6)
