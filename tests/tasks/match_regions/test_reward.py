"""The environment's own reward by hand."""

import jax.numpy as jnp
import numpy as np
import pytest

from tasks.match_regions.reward import REACH_PER_TARGET, Reward, environment_reward
from tasks.match_regions.state import grasp_point
from tests.helpers.match_regions import TASK, demo_qpos, placed, start


def test_environment_reward_by_hand() -> None:
    task = TASK.with_reward(reach=0.0)
    state = start().pipeline_state
    qpos = placed(placed(np.array(state.qpos), 0, 0.4, 0.35), 1, -0.2, 0.35)
    moved = state._replace(qpos=jnp.asarray(qpos))
    # The star is inside: distance 0. The square is 0.6 from the centre (0.4, 0.35). No distractor is inside.
    potential = float(state.initial_distance.sum()) - 0.6 - 0.1
    expected = 10 * np.tanh(potential / 2)
    assert float(environment_reward(moved, task.reward)) == pytest.approx(expected, abs=1e-4)


def reach_term(qpos: np.ndarray) -> float:
    """What the reach term takes from the potential p at a coefficient of 0.25, divided by it."""
    state = start().pipeline_state._replace(qpos=jnp.asarray(qpos))
    rewards = [float(environment_reward(state, Reward(reach=reach))) / 10 for reach in (0.0, 0.25)]
    return 2 * (np.arctanh(rewards[0]) - np.arctanh(rewards[1])) / 0.25


def test_reach_term_by_hand() -> None:
    none_placed = demo_qpos()
    grasp = np.asarray(grasp_point(none_placed))
    to_star, to_square = (np.hypot(*(place - grasp)) for place in (none_placed[5:7], none_placed[8:10]))
    assert reach_term(none_placed) == pytest.approx(min(to_star, to_square) + REACH_PER_TARGET, abs=0.01)
    star_placed = placed(none_placed, 0, 0.4, 0.35)
    assert reach_term(star_placed) == pytest.approx(to_square, abs=0.01)
    assert reach_term(placed(star_placed, 1, 0.3, 0.3)) == pytest.approx(0.0, abs=0.01)
