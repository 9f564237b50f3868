"""Wrappers on the sliding boxes, whose every number can be told by hand."""

from dataclasses import replace
from functools import cache, partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from brax.envs.base import State

from graphrl_jax.encoder.pooling import PoolingParams
from graphrl_jax.rl.batch import vectorise
from graphrl_jax.rl.config import PPOConfig
from graphrl_jax.rl.wrappers import (
    AutoReset,
    Decisions,
    EnvironmentReward,
    Episode,
    GraphReward,
    episodic,
    observed,
)
from graphrl_jax.runtime import jit_physics
from tests.helpers.probe_environments import CountingModel, SlidingBoxes

EPISODE_LENGTH = 4
NUM_ENVS = 3
CONFIG = PPOConfig(num_envs=NUM_ENVS, num_minibatches=1, episode_length=EPISODE_LENGTH)
TAU = 0.5  # of a diagonal of 0.141: a way of 0.1 counts as motion, one of 0.05 does not
POOLING = PoolingParams(1.0, 1.0, 0.0, jnp.float32(TAU))
MODEL = CountingModel(jnp.float32(2.0), POOLING)


@cache
def rollout(reward: str, ends_by_itself_after: int = 1000, config: PPOConfig = CONFIG) -> State:
    """States (T, B, ...): the reset, 11 decisions. Environment 0 stays, 1 creeps (0.05 a step), 2 strides (0.1)."""
    return jax.tree.map(np.asarray, run(reward, config, ends_by_itself_after, jax.random.key(0)))


def paid(task: SlidingBoxes, reward: str) -> EnvironmentReward:
    return GraphReward(task, MODEL) if reward == "graph" else EnvironmentReward(task, POOLING)


@partial(jit_physics, static_argnums=(0, 1))
def run(reward: str, config: PPOConfig, ends_by_itself_after: jax.Array, key: jax.Array) -> State:
    env = vectorise(paid(SlidingBoxes(ends_by_itself_after), reward), config)
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
    assert not active[:, 0].any() and not active[:, :, 1:].any()
    np.testing.assert_array_equal(active[:4, 1, 0], [False, False, True, True])
    np.testing.assert_array_equal(active[:4, 2, 0], [False, True, True, True])


def test_activity_does_not_leak_into_the_next_episode():
    info = rollout("graph").info
    # Resets fall on steps 4 and 8; the jump from the old episode's last place to the new one's first is no motion.
    np.testing.assert_array_equal(info["active"][:, 2, 0], [0, 1, 1, 1, 0, 1, 1, 1, 0, 1, 1, 1])
    for first in (0, 4, 8):
        expected = np.broadcast_to(info["boxes"][first], info["boxes"][first : first + 4].shape)
        np.testing.assert_array_equal(info["reference_boxes"][first : first + 4], expected)


def test_the_rule_of_activity_is_the_poolings():
    @partial(jit_physics, static_argnums=0)
    def flags(rule: str) -> jax.Array:
        env = EnvironmentReward(SlidingBoxes(), replace(POOLING, activity=rule))
        state, found = env.reset(jax.random.key(0)), []
        for action in (0.5, 0.5, 1.0, 0.0):
            state = env.step(state, jnp.array([action]))
            found.append(state.info["active"][0])
        return jnp.stack(found)

    np.testing.assert_array_equal(flags("displacement"), [False, True, True, True])
    np.testing.assert_array_equal(flags("frame_motion"), [False, False, True, True])
    np.testing.assert_array_equal(flags("momentary"), [False, False, True, False])


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


def test_a_step_is_an_advance_to_the_end_and_a_renewal_after_it():
    env = AutoReset(Episode(EnvironmentReward(SlidingBoxes(), POOLING), 2))
    advance, renew, step = (jit_physics(function) for function in (env.advance, env.renew, env.step))
    first, action = jit_physics(env.reset)(jax.random.key(3)), jnp.ones(1)
    midway = advance(first, action)
    np.testing.assert_array_equal(renew(midway).obs, midway.obs)
    last = advance(renew(midway), action)
    assert midway.done == 0 and last.done == last.info["truncation"] == 1
    assert last.obs[0] == first.obs[0] + 0.2 and last.info["steps"] == 2
    fresh, stepped = renew(last), step(step(first, action), action)
    assert fresh.info["steps"] == 0 and fresh.reward == last.reward and not np.isin(last.obs[:3], fresh.obs).any()
    for name in ("obs", "reward", "done", "pipeline_state"):
        jax.tree.map(np.testing.assert_array_equal, getattr(fresh, name), getattr(stepped, name))


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


@pytest.mark.parametrize("reward", ["graph", "environment"])
def test_progress_pays_what_the_reward_has_gained_since_the_last_step(reward):
    plain, states = rollout(reward), rollout(reward, config=replace(CONFIG, progress=True))
    expected = np.diff(plain.reward, axis=0, prepend=0.0)
    # The first step of an episode pays nothing: its reward is not compared with the last episode's.
    expected[[0, 1, 5, 9]] = 0.0
    np.testing.assert_allclose(states.reward, expected, atol=1e-5)
    for first, last in ((1, 4), (5, 8)):
        gained = plain.reward[last] - plain.reward[first]
        np.testing.assert_allclose(states.reward[first : last + 1].sum(0), gained, atol=1e-5)
    assert np.ptp(plain.reward[1:5], axis=0).max() > 0.2


@pytest.mark.parametrize("steps", [1, 2])
def test_progress_changes_nothing_but_what_is_paid(steps):
    config = replace(CONFIG, decision_steps=steps)
    plain, states = rollout("graph", config=config), rollout("graph", config=replace(config, progress=True))
    np.testing.assert_array_equal(states.obs, plain.obs)
    np.testing.assert_array_equal(states.done, plain.done)
    for name, values in plain.metrics.items():  # the return of the plain reward among them
        np.testing.assert_array_equal(states.metrics[name], values, err_msg=name)
    for name, values in plain.info.items():
        jax.tree.map(np.testing.assert_array_equal, states.info[name], values)


@pytest.mark.parametrize("patience", [0, 3])
def test_an_episode_without_progress_ends_for_good_once_patience_is_over(patience):
    config = replace(CONFIG, episode_length=12, progress=True, patience=patience, stagger_episodes=False)
    states = rollout("environment", config=config)
    # The first step is the best so far; without a better one the episode ends three steps later.
    ends = np.isin(np.arange(12), [4, 8]) if patience else np.zeros(12, bool)
    np.testing.assert_array_equal(states.done[:, 0] > 0, ends)
    assert not states.done[:, 1:].any()
    assert not states.info["truncation"].any()


def test_an_episode_that_is_stuck_at_its_time_limit_has_ended_for_good():
    states = rollout("environment", config=replace(CONFIG, progress=True, patience=3))
    np.testing.assert_array_equal(states.done[EPISODE_LENGTH], 1)
    np.testing.assert_array_equal(states.info["truncation"][EPISODE_LENGTH], [0, 1, 1])


def test_patience_counts_control_steps_and_can_end_a_decision_early():
    config = replace(CONFIG, episode_length=12, progress=True, patience=2, decision_steps=4)
    states = rollout("environment", config=config)
    np.testing.assert_array_equal(states.done[1], [1, 0, 0])
    np.testing.assert_array_equal(states.metrics["episode_length"][1], [3, 4, 4])


class Leaving(SlidingBoxes):
    """Its robot retreats to the left."""

    retreat_action = (-1.0,)


def test_a_robot_that_is_stuck_retreats_before_its_episode_ends():
    config = replace(CONFIG, episode_length=12, progress=True, patience=3, retreat=2, stagger_episodes=False)
    env = vectorise(EnvironmentReward(Leaving(), MODEL.pooling), config)
    state = jax.jit(env.reset)(jax.random.split(jax.random.key(0), NUM_ENVS))
    step = jax.jit(env.step)
    places, stuck = [state.pipeline_state[0][:, 0]], [state.info["stuck"]]
    # Nothing is asked for, so a box moves only in a retreat, which is in the last two of three steps.
    while not state.done.any():
        state = step(state, jnp.zeros((NUM_ENVS, 1)))
        places.append(state.pipeline_state[0][:, 0])
        stuck.append(state.info["stuck"])
    moved, before = np.diff(places, axis=0), np.array(stuck[:-1])
    going_on = np.asarray(state.done) == 0
    np.testing.assert_array_equal((moved < 0)[:-1], (before >= 1)[:-1])
    np.testing.assert_array_equal((moved < 0)[-1, going_on], before[-1, going_on] >= 1)
    assert (moved < 0).any() and not (moved > 0)[:-1].any()


class Remembering(SlidingBoxes):
    """An episode starts with the second box where the first one was at the end of the episode before."""

    def restart(self, rng: jax.Array, last: State) -> State:
        places = self.reset(rng).pipeline_state[0].at[1].set(last.pipeline_state[0][0])
        return self._state(places, jnp.zeros((), jnp.int32), jnp.zeros(()))


@pytest.mark.parametrize("config", [CONFIG, replace(CONFIG, progress=True, decision_steps=2)])
def test_a_task_may_start_an_episode_by_how_the_one_before_ended(config):
    env = vectorise(GraphReward(Remembering(), MODEL), config)
    state = jax.jit(env.reset)(jax.random.split(jax.random.key(0), NUM_ENVS))
    step = jax.jit(env.step)
    for _ in range(EPISODE_LENGTH // config.decision_steps):
        first = state.pipeline_state[0][:, 0]
        state = step(state, jnp.ones((NUM_ENVS, 1)))
    np.testing.assert_array_equal(state.done, 1)
    found = state.pipeline_state[0]
    np.testing.assert_allclose(found[:, 1], first + 0.1 * config.decision_steps, atol=1e-6)
    # What the wrappers add is that of a new episode.
    np.testing.assert_array_equal(state.info["boxes"][:, 1, 0], found[:, 1])
    assert (state.info["steps"] == 0).all() and not state.info["active"].any()


@pytest.mark.parametrize("progress", [False, True])
@pytest.mark.parametrize("steps", [2, 4])
def test_a_decision_is_paid_what_its_control_steps_are(steps, progress):
    config = replace(CONFIG, progress=progress)
    each, states = rollout("graph", config=config), rollout("graph", config=replace(config, decision_steps=steps))
    # The first episode: later ones start elsewhere, because there are fewer resets to draw a key for.
    decisions = EPISODE_LENGTH // steps
    summed = each.reward[1 : 1 + EPISODE_LENGTH].reshape(decisions, steps, NUM_ENVS).sum(1)
    np.testing.assert_allclose(states.reward[1 : decisions + 1], summed, atol=1e-4)
    np.testing.assert_array_equal(states.obs[:decisions], each.obs[:EPISODE_LENGTH:steps])
    np.testing.assert_array_equal(states.done[: decisions + 1], each.done[: EPISODE_LENGTH + 1 : steps])


EPISODE = 12
DECISIONS = [[0.5], [1.0], [-0.3]]


@partial(jit_physics, static_argnums=0)
def decided(reward: str, ends_by_itself_after: jax.Array, key: jax.Array) -> list[State]:
    """States after the reset and after each of `DECISIONS`, of four control steps each."""
    config = replace(CONFIG, episode_length=EPISODE, decision_steps=4)
    env = episodic(paid(SlidingBoxes(ends_by_itself_after), reward), config)
    states = [env.reset(key)]
    for action in jnp.array(DECISIONS):
        states.append(env.step(states[-1], action))
    return states


@partial(jit_physics, static_argnums=0)
def controlled(reward: str, ends_by_itself_after: jax.Array, key: jax.Array) -> list[State]:
    """States after the reset and after each control step, with each of `DECISIONS` held for four."""
    env = Episode(paid(SlidingBoxes(ends_by_itself_after), reward), EPISODE)

    def step(state: State, action: jax.Array) -> tuple[State, State]:
        state = env.step(state, action)
        return state, state

    first = env.reset(key)
    _, rest = jax.lax.scan(step, first, jnp.repeat(jnp.array(DECISIONS), 4, axis=0))
    return jax.tree.map(lambda one, more: jnp.concatenate([one[None], more]), first, rest)


@pytest.mark.parametrize("reward", ["graph", "environment"])
def test_a_decision_is_control_steps_with_the_action_held(reward):
    key = jax.random.key(4)
    states, each = decided(reward, 1000, key), controlled(reward, 1000, key)
    for number, state in enumerate(states):
        by_hand = jax.tree.map(lambda leaf, at=4 * number: leaf[at], each)
        earned = each.reward[4 * number - 3 : 4 * number + 1].sum() if number else 0.0
        np.testing.assert_allclose(state.reward, earned, rtol=1e-6)
        jax.tree.map(np.testing.assert_array_equal, state, by_hand.replace(reward=state.reward))
    assert [int(state.info["steps"]) for state in states] == [0, 4, 8, 12]
    assert [float(state.info["truncation"]) for state in states] == [0, 0, 0, 1]
    assert [float(state.done) for state in states] == [0, 0, 0, 1]


def test_an_episode_that_ends_by_itself_between_decisions_ends_there():
    key = jax.random.key(4)
    states, each = decided("environment", 6, key), controlled("environment", 6, key)
    last = states[2]
    assert (float(last.done), float(last.info["truncation"]), int(last.info["steps"])) == (1, 0, 6)
    np.testing.assert_array_equal(last.pipeline_state[0], each.pipeline_state[0][6])
    np.testing.assert_allclose(last.reward, each.reward[5:7].sum(), rtol=1e-6)
    np.testing.assert_allclose(last.metrics["episode_return"], each.reward[1:7].sum(), rtol=1e-6)
    assert float(last.metrics["episode_length"]) == 6
    # In training the next decision is the first of a new episode.
    training = rollout("environment", 6, replace(CONFIG, episode_length=EPISODE, decision_steps=4))
    np.testing.assert_array_equal(training.info["steps"][:, 0], [0, 4] * 6)
    np.testing.assert_array_equal(training.metrics["episode_length"][2::2], 6)


def test_one_step_per_decision_needs_no_wrapper():
    env = paid(SlidingBoxes(), "environment")
    assert isinstance(episodic(env, CONFIG), Episode)
    assert isinstance(episodic(env, replace(CONFIG, decision_steps=2)), Decisions)


def test_resets_and_steps_use_no_key_twice():
    env = AutoReset(Episode(EnvironmentReward(SlidingBoxes(), POOLING), EPISODE_LENGTH))

    @jit_physics
    def reset_and_step(key: jax.Array) -> State:
        return env.step(env.step(env.reset(key), jnp.zeros(1)), jnp.zeros(1))

    with jax.debug_key_reuse(True):
        reset_and_step(jax.random.key(0))


class Listed(SlidingBoxes):
    """Its boxes as objects of a policy of a set: there, and where."""

    def nodes(self, state: State) -> jax.Array:
        places, _ = state.pipeline_state
        return jnp.stack([jnp.ones(2), places[:2]], axis=-1)


def test_a_policy_of_a_set_sees_the_objects_after_the_rest_of_the_observation():
    flat, listed = (observed(Listed(), config) for config in (PPOConfig(), PPOConfig(policy="set", nodes=(2, 2))))
    key = jax.random.key(0)
    assert (flat.observation_size, listed.observation_size) == (3, 7)
    for before, after in (
        (flat.reset(key), listed.reset(key)),
        (flat.step(flat.reset(key), jnp.ones(1)), listed.step(listed.reset(key), jnp.ones(1))),
    ):
        nodes = [1.0, before.obs[0], 1.0, before.obs[1]]
        np.testing.assert_allclose(after.obs, [*before.obs, *nodes])
