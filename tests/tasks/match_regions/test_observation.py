"""What a policy sees, number by number."""

import jax.numpy as jnp
import numpy as np
import pytest

from tasks.match_regions.observation import observe, observe_blocks
from tasks.match_regions.state import PhysicsState
from tests.helpers.match_regions import DEMO, TASK, alone, placed, start


def test_observation_has_its_documented_size_and_frame() -> None:
    state = start()
    assert state.obs.shape == (TASK.observation_size,)
    qpos = alone((0.1, 0.2, 0.7))
    ahead = np.array([-np.sin(0.7), np.cos(0.7)])
    qpos = placed(qpos, 0, *(np.array([0.1, 0.2]) + 0.4 * ahead))
    obs = np.asarray(observe(state.pipeline_state._replace(qpos=jnp.asarray(qpos, jnp.float32))))
    np.testing.assert_allclose(obs[13:15], [0.3, 0.35], atol=1e-5)  # the region's half sides
    np.testing.assert_allclose(obs[15:17], [0.4, 0.0], atol=1e-5)  # the star: 0.4 ahead, 0 to the left
    np.testing.assert_allclose(obs[22:25], [0.4, 1.0, 0.0], atol=1e-5)
    np.testing.assert_array_equal(obs[[21, 32, 37]], [0, 0, 1])


def test_distractors_are_seen_nearest_first() -> None:
    qpos = placed(placed(alone((0.0, 0.0, 0.0)), 4, 0.0, 0.5), 2, 0.3, 0.6)
    state = PhysicsState(jnp.asarray(qpos), jnp.zeros(20), jnp.zeros(20), jnp.ones(2), DEMO)
    obs = np.asarray(observe(state))[38:].reshape(3, 7)
    # The robot faces up: ahead is y, left is minus x.
    np.testing.assert_allclose(obs[:, :2], [[0.5, 0.0], [0.6, -0.3], [-0.85, -0.4]], atol=1e-5)
    np.testing.assert_array_equal(obs[:, 6], [0, 1, 0])


@pytest.mark.parametrize(
    "star, square, star_first",
    [
        pytest.param((-0.3, 0.0), (0.0, -0.6), True, id="nearer"),
        pytest.param((-0.9, 0.0), (0.0, -0.6), False, id="farther"),
        pytest.param((-0.9, 0.0), (0.3, 0.3), True, id="farther, the other placed"),
        pytest.param((0.6, 0.6), (0.3, 0.3), False, id="both placed"),
    ],
)
def test_the_target_to_see_to_comes_first(star, square, star_first) -> None:
    qpos = placed(placed(alone((0.0, 0.0, 0.0)), 0, *star), 1, *square)
    state = PhysicsState(jnp.asarray(qpos), jnp.zeros(20), jnp.zeros(20), jnp.array([1.0, 2.0]), DEMO)
    obs = np.asarray(observe(state))
    # The robot faces up: ahead is y, left is minus x.
    rows = [[y, -x] for x, y in (star, square)]
    np.testing.assert_allclose(obs[[15, 16, 26, 27]], np.ravel(rows if star_first else rows[::-1]), atol=1e-5)
    assert obs[37] == star_first and obs[25] == (1.0 if star_first else 2.0)
    in_slots = np.asarray(observe(state, targets_in_order=False))
    np.testing.assert_allclose(in_slots[[15, 16, 26, 27]], np.ravel(rows), atol=1e-5)
    np.testing.assert_array_equal(np.delete(in_slots, np.s_[15:38]), np.delete(obs, np.s_[15:38]))


def test_blocks_of_a_set_have_their_documented_features() -> None:
    qpos = placed(placed(alone((0.0, 0.0, 0.0)), 0, -0.3, 0.4), 4, 0.0, 0.5)
    world = DEMO._replace(present=jnp.array([True, True, False, True, True]))
    state = PhysicsState(jnp.asarray(qpos), jnp.zeros(20), jnp.zeros(20), jnp.array([1.0, 2.0]), world)
    blocks = np.asarray(observe_blocks(state, jnp.array([True, False, False, False, True])))
    assert blocks.shape == (5, 24) and not blocks[2].any()
    np.testing.assert_array_equal(blocks[[0, 1, 3, 4], 0], 1)
    # The robot faces up: ahead is y, left is minus x. The star is 0.5 away; the region's centre is (0.4, 0.35).
    np.testing.assert_allclose(blocks[0, 1:3], [0.4, 0.3], atol=1e-5)
    np.testing.assert_allclose(blocks[0, 8:13], [0.5, 0.8, 0.6, -0.05, -0.7], atol=1e-5)
    np.testing.assert_array_equal(blocks[[0, 1, 3, 4], 13], [1, 1, 0, 0])
    np.testing.assert_array_equal(blocks[[0, 1, 3, 4], 14], [1, 0, 0, 1])
    np.testing.assert_array_equal(blocks[[0, 1, 3, 4], 15:23].sum(-1), 2)
    np.testing.assert_array_equal(blocks[[0, 1, 3, 4], 23], [1, 2, 0, 0])
