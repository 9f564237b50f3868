"""Episodes of a policy on the probe, whose returns are known, and frames of episodes of sliding boxes."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from brax.envs.base import State

from graphrl_jax.encoder.pooling import PoolingParams
from graphrl_jax.rl import ppo
from graphrl_jax.rl.actors import Actor
from graphrl_jax.rl.config import PPOConfig
from graphrl_jax.rl.rollout import evaluate, record
from graphrl_jax.rl.wrappers import EnvironmentReward
from tests.helpers.probe_environments import SlidingBoxes
from tests.helpers.probe_training import ACTION_PROBE, CONFIG, make_env, trained


def test_evaluation_reports_every_episode():
    state, _ = trained(ACTION_PROBE)
    reward = ppo.as_float32(replace(ACTION_PROBE, length=3.0))
    outcomes = evaluate(CONFIG, make_env, reward, ppo.policy_params(state), jax.random.key(3), num_episodes=50)
    assert {name: array.shape for name, array in outcomes.items()} == dict.fromkeys(ppo.OUTCOMES, (50,))
    np.testing.assert_array_equal(outcomes["episode_length"], 3.0)
    np.testing.assert_array_equal(outcomes["success"], 1.0)
    # The policy is deterministic and x is constant, so each of the three steps errs by the same amount.
    np.testing.assert_allclose(outcomes["episode_return"], -3.0 * np.log(outcomes["score"]) ** 2, atol=1e-2)


def success_and_failure(state: State) -> jax.Array:
    """Two events of the probe: that it succeeds, and that it fails."""
    return jnp.array([True, False]) == (state.metrics["success"] > 0)


def test_evaluation_reports_the_events_that_hold_at_the_end():
    state, _ = trained(ACTION_PROBE)
    inputs = CONFIG, make_env, ppo.as_float32(ACTION_PROBE), ppo.policy_params(state), jax.random.key(3)
    found = evaluate(*inputs, num_episodes=50, events=success_and_failure)
    assert found.keys() == {*ppo.OUTCOMES, "events"}
    np.testing.assert_array_equal(found["events"][:, 0], found["success"] > 0)
    np.testing.assert_array_equal(found["events"][:, 1], found["success"] == 0)


def test_how_seldom_a_policy_decides_is_all_the_same_if_it_sees_no_change():
    state, _ = trained(ACTION_PROBE)
    reward = ppo.as_float32(replace(ACTION_PROBE, length=4.0))
    outcomes = [
        evaluate(config, make_env, reward, ppo.policy_params(state), jax.random.key(3), num_episodes=50)
        for config in (CONFIG, replace(CONFIG, decision_steps=2, progress=True))
    ]
    for name in ppo.OUTCOMES:
        np.testing.assert_allclose(outcomes[1][name], outcomes[0][name], rtol=1e-5, err_msg=name)


def shy(_: None) -> Actor:
    """Pushes with full force, but rests in every second decision."""

    def act(count: jax.Array, state: State, key: jax.Array) -> tuple[jax.Array, jax.Array]:
        return count + 1, jnp.full((*state.done.shape, 1), 1.0) * (count % 2 == 0)

    return Actor(lambda state, key: jnp.zeros((), jnp.int32), act)


@pytest.mark.parametrize("steps", [1, 2])
def test_any_actor_remembers_from_decision_to_decision(steps):
    task = Sliding()
    config = PPOConfig(episode_length=12, decision_steps=steps)

    def pays(pooling: PoolingParams) -> EnvironmentReward:
        return EnvironmentReward(task, pooling)

    inputs = config, pays, ppo.as_float32(PoolingParams()), None, jax.random.key(1)
    found = record(task, *inputs, 3, make_actor=shy)
    ways = np.diff(found.states[0][:, :, 0], axis=1)
    moves = np.repeat(np.arange(12 // steps) % 2 == 0, steps)[1:]
    np.testing.assert_allclose(ways, np.broadcast_to(0.1 * moves, (3, 11)), atol=1e-6)
    outcomes = evaluate(*inputs, num_episodes=3, make_actor=shy)
    # Half of twelve steps of 0.1.
    np.testing.assert_allclose(outcomes["score"], 0.6 + starts_of(task, 3), atol=1e-5)


def starts_of(task: SlidingBoxes, episodes: int) -> np.ndarray:
    """Where the first box is at the start of the episodes of `evaluate` with the key 1."""
    reset_key, _ = jax.random.split(jax.random.key(1))
    states = jax.vmap(task.reset)(jax.random.split(reset_key, episodes))
    return np.asarray(states.pipeline_state[0][:, 0])


class Sliding(SlidingBoxes):
    """The sliding boxes with what a recording needs of a task; the event is the success."""

    episode_length = 12

    def events(self, state: State) -> jax.Array:
        return state.metrics["success"][None] > 0


@pytest.mark.parametrize("steps", [1, 4])
def test_a_recording_has_every_control_step_and_one_action_per_decision(steps):
    task = Sliding()
    config = PPOConfig(num_envs=4, num_minibatches=1, episode_length=12, decision_steps=steps, policy_hidden=(8,))

    def pays(pooling: PoolingParams) -> EnvironmentReward:
        return EnvironmentReward(task, pooling)

    pooling = ppo.as_float32(PoolingParams())
    normalizer, policy = ppo.policy_params(ppo.init_jit(config, pays, pooling, jax.random.key(0)))
    # A policy that acts boldly, and differently from place to place.
    policy = jax.tree.map(lambda leaf: 30.0 * leaf, policy)
    found = record(task, config, pays, pooling, (normalizer, policy), jax.random.key(1), 5)
    places, ages = found.states
    np.testing.assert_array_equal(ages, np.broadcast_to(np.arange(1, 13), (5, 12)))
    assert found.boxes.shape == (5, 12, 3, 4) and found.events.shape == (5, 1)
    np.testing.assert_array_equal(found.boxes[:, :, 0, 0], places[:, :, 0])
    np.testing.assert_array_equal(found.rewards, places[:, :, 0])
    ways = np.diff(places[:, :, 0], axis=1)
    changes = np.abs(np.diff(ways, axis=1)) > 1e-6  # of the action, after the control steps 2 to 11
    between = np.arange(2, 12) % steps != 0
    assert not changes[:, between].any() and changes[:, ~between].any(axis=0).all()
