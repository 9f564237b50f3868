"""Programs without guards are spoiled by what the guards keep out, so the measured difference is theirs."""

import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.unguarded import unguarded
from graphrl_jax.optimizer import adam_init, adam_update
from graphrl_jax.rl.batch import vectorise
from graphrl_jax.rl.config import PPOConfig
from tests.helpers.probe_environments import Probe, ProbeReward

CONFIG = PPOConfig(num_envs=2, unroll_length=2, num_minibatches=2, episode_length=4)


def test_without_its_guard_a_gradient_that_is_not_finite_is_followed():
    params = {"w": jnp.ones(2)}
    arguments = {"w": jnp.array([jnp.nan, 1.0])}, adam_init(params), params, 0.1

    def update(*arguments):
        return adam_update(*arguments)[0]["w"]

    np.testing.assert_array_equal(jax.jit(update)(*arguments), [1, 1])
    assert np.isnan(jax.jit(unguarded(update))(*arguments)[0])
    assert not jnp.isfinite(jnp.nan)  # the guard is back


def test_without_its_guard_a_state_that_is_not_finite_stays():
    env = vectorise(Probe(ProbeReward(constant=float("nan"), length=9.0)), CONFIG)
    state = jax.jit(env.reset)(jax.random.split(jax.random.key(0), 2))
    action = jnp.zeros((2, 1))
    np.testing.assert_array_equal(jax.jit(env.step)(state, action).metrics["bad_envs"], 1)
    after = jax.jit(unguarded(lambda state: env.step(state, action)))(state)
    np.testing.assert_array_equal(after.metrics["bad_envs"], 0)
    assert np.isnan(after.reward).all()
