"""An environment whose physics diverges is reset, teaches nothing and is counted; the others go on."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
from brax.envs.base import State

from graphrl_jax.rl import ppo
from graphrl_jax.rl.batch import vectorise
from graphrl_jax.rl.config import PPOConfig, PPOHyper
from tests.helpers import probe_training as training
from tests.helpers.probe_environments import Probe, ProbeReward
from tests.helpers.probe_training import ACTION_PROBE

CONFIG = PPOConfig(num_envs=8, unroll_length=4, num_epochs=1, num_minibatches=2, episode_length=6)


class Diverging(Probe):
    """A probe whose state turns NaN under actions above 0.5."""

    def step(self, state: State, action: jax.Array) -> State:
        state = super().step(state, action)
        bad = action[0] > 0.5
        x = jnp.where(bad, jnp.nan, state.pipeline_state["x"])
        nan = jnp.where(bad, jnp.nan, 0.0)
        return state.replace(
            pipeline_state={**state.pipeline_state, "x": x},
            obs=state.obs + nan,
            reward=state.reward + nan,
            metrics={name: value + nan for name, value in state.metrics.items()},
        )


def make_env(reward: ProbeReward) -> Diverging:
    return Diverging(reward)


PAYS = ProbeReward(constant=1.0, length=100.0)


def test_a_bad_environment_starts_anew_and_the_others_go_on():
    env = vectorise(Diverging(PAYS), CONFIG)
    state = jax.jit(env.reset)(jax.random.split(jax.random.key(0), 3))
    state = jax.jit(env.step)(state, jnp.array([[0.0], [1.0], [0.0]]))
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves((state.pipeline_state, state.obs, state.metrics)))
    np.testing.assert_array_equal(state.metrics["bad_envs"], [0, 1, 0])
    np.testing.assert_array_equal(state.done, [0, 1, 0])
    np.testing.assert_array_equal(state.info["truncation"], [0, 1, 0])
    np.testing.assert_array_equal(state.info["steps"], [1, 0, 1])
    np.testing.assert_array_equal(state.reward, [1, 0, 1])


def test_training_goes_on_with_finite_parameters_and_counts_what_was_bad():
    state = ppo.init_jit(CONFIG, make_env, PAYS, jax.random.key(1))
    state, metrics = ppo.train_chunk(CONFIG, make_env, PPOHyper(), PAYS, state, 3)
    leaves = jax.tree.leaves((state.params, state.normalizer, state.return_statistics, state.env_state.obs))
    assert all(np.isfinite(leaf).all() for leaf in leaves)
    # The policy starts near mean 0 with a deviation of 0.6, so a fair share of its actions is above 0.5.
    assert 0.05 < float(metrics["bad_envs"].mean()) < 0.5


class Huge(Probe):
    """A probe whose observation is finite but beyond all bounds under actions above 0.5."""

    def step(self, state: State, action: jax.Array) -> State:
        state = super().step(state, action)
        return state.replace(obs=jnp.where(action[0] > 0.5, 1e30, state.obs))


def test_a_state_beyond_all_bounds_is_bad_before_it_is_nan():
    env = vectorise(Huge(PAYS), CONFIG)
    state = jax.jit(env.reset)(jax.random.split(jax.random.key(0), 3))
    state = jax.jit(env.step)(state, jnp.array([[0.0], [1.0], [0.0]]))
    np.testing.assert_array_equal(state.metrics["bad_envs"], [0, 1, 0])
    assert (np.abs(state.obs) < 10).all()


class Poisoned(Probe):
    """A probe of which one episode in 64 turns NaN for good at its first step, once `observation` is not 0."""

    def reset(self, rng: jax.Array) -> State:
        state = super().reset(rng)
        poison = jax.random.bernoulli(jax.random.fold_in(rng, 1), 1 / 64) & (self.reward.observation != 0)
        return state.replace(pipeline_state={**state.pipeline_state, "poison": poison})

    def step(self, state: State, action: jax.Array) -> State:
        poison = state.pipeline_state["poison"]
        after = super().step(state, action)
        nan = jnp.where(poison, jnp.nan, 0.0)
        after = after.replace(pipeline_state={**after.pipeline_state, "poison": poison})
        return after.replace(obs=after.obs + nan, reward=after.reward + nan)


def test_what_is_learned_beside_a_poisoned_environment_is_what_is_learned_without():
    found = {}
    healthy = replace(ACTION_PROBE, observation=0.0)
    for name, rewards in (
        ("healthy", [healthy] * 3),
        ("poisoned", [healthy, *[replace(healthy, observation=1e-9)] * 2]),
    ):
        scores = []
        for seed in range(4):
            state = ppo.init_jit(training.CONFIG, Poisoned, ppo.as_float32(rewards[0]), jax.random.key(seed))
            for reward in rewards:
                chunk = (training.CONFIG, Poisoned, training.HYPER, ppo.as_float32(reward), state, training.CHUNK)
                state, metrics = ppo.train_chunk(*chunk)
            # Poisoned episodes have no score.
            scores.append(float(metrics["score"].mean() / (1 - metrics["bad_envs"].mean())))
            share = 1 / 64 if name == "poisoned" else 0
            np.testing.assert_allclose(metrics["bad_envs"].mean(), share, atol=0.003)
            assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves((state.params, state.normalizer)))
        found[name] = scores
    spread = max(np.ptp(found["healthy"]), 0.02)
    assert abs(np.mean(found["poisoned"]) - np.mean(found["healthy"])) <= spread
    assert min(found["poisoned"]) > 0.8


def test_gradient_steps_that_are_not_finite_are_left_out_and_counted():
    state = ppo.init_jit(CONFIG, Probe, PAYS, jax.random.key(1))
    before = jax.tree.map(np.asarray, state.params)
    state, metrics = ppo.train_chunk(CONFIG, Probe, PPOHyper(reward_scaling=float("nan")), PAYS, state, 2)
    np.testing.assert_array_equal(metrics["skipped_steps"], 1)
    jax.tree.map(np.testing.assert_array_equal, state.params, before)
    state, metrics = ppo.train_chunk(CONFIG, Probe, PPOHyper(), PAYS, state, 1)
    np.testing.assert_array_equal(metrics["skipped_steps"], 0)
    assert not all(jax.tree.leaves(jax.tree.map(np.array_equal, state.params, before)))
