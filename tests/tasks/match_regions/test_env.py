"""The environment: its physics against MuJoCo's, its controls and its resets."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from graphrl_jax.encoder.pooling import PoolingParams
from graphrl_jax.rl.wrappers import EnvironmentReward
from graphrl_jax.runtime import jit_physics
from tasks.match_regions import env, geometry, layouts, magical
from tasks.match_regions.model import CONTROL_DT, DRIVEN_MASS, FAITHFUL
from tasks.match_regions.task import MatchRegions
from tests.helpers.match_regions import DEMO, SOLVED, TASK, alone, demo_qpos, placed, simulate, start

ADVANCE = jit_physics(TASK.advance)


@pytest.mark.parametrize(
    "engine, physics, tolerance",
    [
        pytest.param("mjx", SOLVED, 0.01, id="mjx, solved"),
        pytest.param("mjx", TASK.physics, 0.03, id="mjx, default"),
        pytest.param("mujoco", SOLVED, 1e-3, id="mujoco, solved"),
    ],
)
def test_an_engine_moves_as_mujoco_does(engine, physics, tolerance) -> None:
    """Free motion, gripping, dragging and letting go; with the default's one iteration nearly so."""
    begin = alone((0.0, 0.3, 0.0), (0.05, 0.625))
    commands = [(0.0, 0.0, False)] * 3 + [(-0.6, 0.5, False)] * 5 + [(0.0, 0.0, True)] * 2 + [(-0.6, 0.0, True)] * 4
    state = start().pipeline_state._replace(qpos=jnp.asarray(begin))
    advance = jit_physics(MatchRegions(physics=physics, engine=engine).advance)
    for speed, turn, is_open in commands:
        share = speed / (env.FORWARD_SPEED if speed > 0 else env.BACKWARD_SPEED)
        state = advance(state, jnp.array([share, turn / env.TURN_RATE, 1.0 if is_open else -1.0]))
    found, expected = np.asarray(state.qpos), simulate(begin, commands)
    assert np.linalg.norm(expected[5:7] - begin[5:7]) > 0.2
    np.testing.assert_allclose(found, expected, atol=tolerance)


def test_the_drive_gains_the_same_speed_in_all_directions():
    advance, begin = jit_physics(MatchRegions(physics=FAITHFUL).advance), start().pipeline_state
    gained = FAITHFUL.drive_force / DRIVEN_MASS * CONTROL_DT
    for angle in (0.0, 0.8):
        away = begin._replace(qpos=begin.qpos.at[:3].set(jnp.array([0.3, 0.3, angle])))
        velocity = advance(away, jnp.array([1.0, 0.0, 1.0])).qvel[:2]
        np.testing.assert_allclose(velocity, gained * geometry.heading(jnp.float32(angle)), atol=0.02)


def test_discrete_control_does_what_its_continuous_action_does():
    discrete, begin = jit_physics(MatchRegions(control="discrete").advance), start().pipeline_state
    for number in (1, 12):
        one, other = discrete(begin, jnp.int32(number)).qpos, ADVANCE(begin, magical.action(jnp.int32(number))).qpos
        np.testing.assert_allclose(one, other, atol=1e-6)
    with pytest.raises(ValueError, match="control is 'keys'; allowed: 'continuous' and 'discrete'"):
        MatchRegions(control="keys")


def test_a_target_that_starts_in_its_place_counts_as_moved():
    class Placed(layouts.Demo):
        def sample(self, key):
            start = layouts.Demo(jitter=0.0).sample(key)
            moved = jnp.array([False, False, True, False, False])
            return start._replace(qpos=jnp.asarray(placed(demo_qpos(), 1, 0.4, 0.3)), moved=moved)

    for layout, flags in ((layouts.Demo(), [0, 0, 0]), (Placed(), [0, 1, 1])):
        state = jax.jit(EnvironmentReward(MatchRegions(layout), PoolingParams()).reset)(jax.random.key(0))
        np.testing.assert_array_equal(state.info["active"][2:5], flags)
        np.testing.assert_array_equal(state.info["active"][jnp.array([0, 1, 5, 6, 7])], False)
        # It counts as brought from where the layout had it.
        homes = layouts.BLOCK_STARTS[:2, :2] - np.asarray(geometry.region_centre(DEMO.region))
        found = state.pipeline_state.initial_distance
        np.testing.assert_allclose(found, np.linalg.norm(homes, axis=-1), atol=0.05)
