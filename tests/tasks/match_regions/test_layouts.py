"""Where episodes start."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tasks.match_regions import geometry, layouts
from tasks.match_regions.model import FINGER_OPEN
from tasks.match_regions.state import grasp_point
from tests.helpers.match_regions import DEMO


def test_demo_layout_is_the_recorded_one_up_to_its_jitter() -> None:
    qpos = jax.jit(jax.vmap(layouts.Demo(jitter=0.03).sample))(jax.random.split(jax.random.key(1), 64)).qpos
    offset = np.asarray(qpos[:, 5:].reshape(64, 5, 3)) - layouts.BLOCK_STARTS
    assert np.abs(offset).max() <= 0.03
    assert np.abs(offset).max() > 0.02
    assert not np.allclose(qpos[0], qpos[1])


@pytest.mark.parametrize("layout", [layouts.Demo(jitter=0.5), layouts.Training(layouts.Demo())])
def test_every_layout_stays_inside_the_walls(layout: layouts.Layout) -> None:
    qpos = np.asarray(jax.jit(jax.vmap(layout.sample))(jax.random.split(jax.random.key(2), 256)).qpos)
    assert np.isfinite(qpos).all()
    assert np.abs(qpos[:, :2]).max() <= 0.8
    assert np.abs(qpos[:, 5:].reshape(-1, 5, 3)[..., :2]).max() <= 0.9
    assert np.abs(qpos[:, 3:5]).max() <= FINGER_OPEN + 1e-6


def test_training_starts_cover_placed_and_held_targets() -> None:
    qpos = jax.jit(jax.vmap(layouts.Training(layouts.Demo()).sample))(jax.random.split(jax.random.key(3), 512)).qpos
    targets = np.asarray(qpos[:, 5:11].reshape(-1, 2, 3)[..., :2])
    inside = np.asarray(geometry.inside_region(DEMO.region, jnp.asarray(targets)))
    assert 0.1 < inside.mean() < 0.4
    held = np.linalg.norm(targets - np.asarray(jax.vmap(grasp_point)(qpos))[:, None], axis=-1).min(1) < 0.02
    assert 0.05 < held.mean() < 0.4


def test_training_bumps_distractors_in_some_episodes() -> None:
    layout, keys = layouts.Training(layouts.Demo(jitter=0.0)), jax.random.split(jax.random.key(4), 512)
    qpos, moved = (np.asarray(part) for part in jax.jit(jax.vmap(layout.sample))(keys)[:2])
    away = np.linalg.norm(qpos[:, 5:].reshape(-1, 5, 3)[..., :2] - layouts.BLOCK_STARTS[:, :2], axis=-1) > 1e-6
    assert not moved[:, :2].any()
    np.testing.assert_array_equal(moved[:, 2:], away[:, 2:])
    assert 0.35 < moved.any(1).mean() < 0.53 and 0.2 < moved[:, 2:].mean() < 0.3
