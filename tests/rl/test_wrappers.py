"""Wrappers on the sliding boxes, whose every number can be told by hand."""

from functools import cache, partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from brax.envs.base import State

from graphrl_jax.encoder.pooling import PoolingParams
from graphrl_jax.rl.wrappers import AutoReset, EnvironmentReward, Episode, GraphReward, stagger, vectorise
from graphrl_jax.runtime import jit_physics
from tests.helpers.probe_environments import CountingModel, SlidingBoxes

EPISODE_LENGTH = 4
NUM_ENVS = 3
TAU = 0.5  # of a diagonal of 0.141: a step of 0.1 counts as motion, one of 0.05 does not
MODEL = CountingModel(jnp.float32(2.0), PoolingParams(1.0, 1.0, 0.0, jnp.float32(TAU)))


@cache
def rollout(reward: str, ends_by_itself_after: int = 1000) -> State:
    """States (T, B, ...) of 11 steps, the reset first. Environment 0 stays, 1 creeps (0.05 a step), 2 strides (0.1)."""
    return jax.tree.map(np.asarray, run(reward, ends_by_itself_after, jax.random.key(0)))


@partial(jit_physics, static_argnums=0)
def run(reward: str, ends_by_itself_after: jax.Array, key: jax.Array) -> State:
    task = SlidingBoxes(ends_by_itself_after)
    env = vectorise(GraphReward(task, MODEL) if reward == "graph" else EnvironmentReward(task, TAU), EPISODE_LENGTH)
    actions = jnp.array([[0.0], [0.5], [1.0]])
    first = env.reset(jax.random.split(key, NUM_ENVS))

    def step(state: State, _: None) -> tuple[State, State]:
        state = env.step(state, actions)
        return state, state

    _, rest = jax.lax.scan(step, first, length=11)
    without_keys = [state.replace(info={**state.info, "reset_key": ()}) for state in (first, rest)]
    return jax.tree.map(lambda a, b: jnp.concatenate([a[None], b]), *without_keys)


def places(states: State) -> np.ndarray:
    return states.pipeline_state[0]


def test_observation_is_the_tasks_followed_by_the_activity_flags():
    states = rollout("graph")
    env = GraphReward(SlidingBoxes(), MODEL)
    assert states.obs.shape == (12, NUM_ENVS, env.observation_size)
    np.testing.assert_array_equal(states.obs[..., :3], places(states))
    np.testing.assert_array_equal(states.obs[..., 3:], states.info["active"].astype(np.float32))


def test_only_motion_beyond_tau_counts_and_it_persists():
    active = rollout("graph").info["active"]
    assert not active[:, :2].any()
    np.testing.assert_array_equal(active[:4, 2, 0], [False, True, True, True])
    assert not active[:, :, 1:].any()


def test_activity_does_not_leak_into_the_next_episode():
    states = rollout("graph")
    # Resets fall on steps 4 and 8; the jump from the old episode's last place to the new one's first is no motion.
    np.testing.assert_array_equal(states.info["active"][:, 2, 0], [0, 1, 1, 1, 0, 1, 1, 1, 0, 1, 1, 1])


def test_info_is_the_new_episodes_after_a_reset():
    states = rollout("graph")
    for step in (4, 8):
        assert (states.done[step] == 1).all()
        assert (states.info["steps"][step] == 0).all()
        assert (states.info["episode_return"][step] == 0).all()
        np.testing.assert_array_equal(states.info["boxes"][step, :, :, 0], places(states)[step])
    assert states.done.sum() == 2 * NUM_ENVS
    np.testing.assert_array_equal(states.info["steps"][:, 0], [0, 1, 2, 3] * 3)


def test_every_reset_draws_a_new_state():
    initial = places(rollout("graph"))[[0, 4, 8]].reshape(-1, 3)
    assert len(np.unique(initial, axis=0)) == 3 * NUM_ENVS
    # Environment 0 never moves, so whatever changes comes from the reset.
    assert len(np.unique(initial[:, 0])) == 3 * NUM_ENVS


def test_graph_reward_replaces_the_reward_and_logs_both():
    states, plain = rollout("graph"), rollout("environment")
    within = [1, 2, 3, 5, 6, 7]
    distance = places(states)[within, :, 0] + 10.0 * states.info["active"][within].sum(-1)
    np.testing.assert_allclose(states.metrics["distance"][within], distance, rtol=1e-6)
    np.testing.assert_allclose(states.reward[within], -2.0 * distance, rtol=1e-6)
    np.testing.assert_allclose(states.metrics["learned_reward"], states.reward)
    np.testing.assert_allclose(states.metrics["env_reward"][within], places(states)[within, :, 0], rtol=1e-6)
    np.testing.assert_allclose(plain.reward, plain.metrics["env_reward"])
    np.testing.assert_allclose(plain.metrics["env_reward"], states.metrics["env_reward"], rtol=1e-6)


def test_both_rewards_see_the_same_observations():
    np.testing.assert_allclose(rollout("graph").obs, rollout("environment").obs, rtol=1e-6)


def test_metrics_at_done_describe_the_finished_episode():
    states = rollout("environment")
    start = places(states)[0, 2, 0]
    rewards = start + 0.1 * np.arange(1, 5)
    np.testing.assert_allclose(states.metrics["episode_return"][4, 2], rewards.sum(), rtol=1e-5)
    np.testing.assert_allclose(states.metrics["score"][4, 2], rewards[-1], rtol=1e-5)
    assert states.metrics["success"][4, 2] == float(rewards[-1] > 0.5)
    np.testing.assert_array_equal(states.metrics["episode_length"][[4, 8]], EPISODE_LENGTH)
    for name, values in states.metrics.items():
        np.testing.assert_array_equal(values, states.info["step_metrics"][name])


@pytest.mark.parametrize("ends_by_itself_after, truncated", [(1000, 1.0), (4, 0.0), (2, 0.0)])
def test_truncation_means_that_only_the_time_limit_ended_the_episode(ends_by_itself_after, truncated):
    states = rollout("environment", ends_by_itself_after)
    length = min(EPISODE_LENGTH, ends_by_itself_after)
    assert (states.done[length] == 1).all()
    assert (states.info["truncation"][length] == truncated).all()
    assert (states.info["truncation"][length + 1] == 0).all()


def test_staggered_starts_spread_over_the_episode():
    nothing = jnp.zeros(200)
    state = State(None, nothing, nothing, nothing, info={"steps": jnp.zeros(200, jnp.int32), "boxes": nothing})
    info = stagger(state, jax.random.key(2), 10).info
    assert set(np.asarray(info["steps"])) == set(range(10))
    assert info["steps"].dtype == np.int32
    assert info["boxes"] is nothing


def test_resets_and_steps_use_no_key_twice():
    env = AutoReset(Episode(EnvironmentReward(SlidingBoxes(), TAU), EPISODE_LENGTH))

    @jit_physics
    def reset_and_step(key: jax.Array) -> State:
        return env.step(env.step(env.reset(key), jnp.zeros(1)), jnp.zeros(1))

    with jax.debug_key_reuse(True):
        reset_and_step(jax.random.key(0))
