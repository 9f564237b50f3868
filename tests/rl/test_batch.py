"""A batch on the sliding boxes: only what is over begins anew."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from brax.envs.base import State

from graphrl_jax.encoder.pooling import PoolingParams
from graphrl_jax.rl.batch import Batch, stagger, vectorise
from graphrl_jax.rl.config import PPOConfig
from graphrl_jax.rl.wrappers import EnvironmentReward
from graphrl_jax.runtime import jit_physics
from tests.helpers.probe_environments import SlidingBoxes

POOLING = PoolingParams(1.0, 1.0, 0.0, jnp.float32(0.5))


def batch_of(config: PPOConfig) -> Batch:
    return vectorise(EnvironmentReward(SlidingBoxes(), POOLING), config)


def first_states(config: PPOConfig, key: jax.Array) -> State:
    reset_key, stagger_key = jax.random.split(key)
    states = batch_of(config).reset(jax.random.split(reset_key, config.num_envs))
    return stagger(states, stagger_key, config)


def renewed_one_by_one(env: Batch, states: State, actions: jax.Array) -> State:
    """The definition: every environment draws a new start, which is kept where the episode is over."""
    states = jax.vmap(env.env.advance)(states, actions)
    fresh = jax.vmap(env.env.renew)(states)
    return jax.tree.map(lambda new, old: jax.vmap(jnp.where)(states.done > 0, new, old), fresh, states)


@pytest.mark.parametrize("num_envs", [1, 3, 50, 300])
@pytest.mark.parametrize("spread", [True, False])
def test_only_what_is_over_begins_anew(num_envs, spread):
    config = PPOConfig(num_envs=num_envs, num_minibatches=1, episode_length=4)
    env, actions = batch_of(config), jnp.linspace(-1.0, 1.0, num_envs)[:, None]
    states = jit_physics(partial(first_states, config))(jax.random.key(5))
    if not spread:
        states = states.replace(info={**states.info, "steps": jnp.zeros_like(states.info["steps"])})
    step, by_definition = jit_physics(env.step), jit_physics(partial(renewed_one_by_one, env))
    ended = []
    for _ in range(6):
        after, expected = step(states, actions), by_definition(states, actions)
        for found, wanted in zip(jax.tree.leaves(after), jax.tree.leaves(expected), strict=True):
            if jnp.issubdtype(found.dtype, jax.dtypes.prng_key):
                found, wanted = jax.random.key_data(found), jax.random.key_data(wanted)
            np.testing.assert_array_equal(found, wanted)
        ended.append(float(after.done.sum()))
        states = after
    assert sum(ended) >= num_envs  # six steps of episodes of four
    assert spread or ended == [0, 0, 0, num_envs, 0, 0]


def test_a_batch_within_a_batch_begins_the_same_episodes():
    config = PPOConfig(num_envs=20, num_minibatches=1, episode_length=4)
    env, actions = batch_of(config), jnp.ones((20, 1))
    keys = jax.random.split(jax.random.key(8), 2)

    def three_steps(key: jax.Array) -> jax.Array:
        states = first_states(config, key)
        for _ in range(3):
            states = env.step(states, actions)
        return states.obs

    apart = np.stack([jit_physics(three_steps)(key) for key in keys])
    np.testing.assert_array_equal(jit_physics(jax.vmap(three_steps))(keys), apart)


@pytest.mark.parametrize("steps, starts", [(1, range(10)), (5, (0, 5)), (10, (0,))])
def test_staggered_starts_spread_over_the_episode(steps, starts):
    nothing = jnp.zeros(200)
    state = State(None, nothing, nothing, nothing, info={"steps": jnp.zeros(200, jnp.int32), "boxes": nothing})
    info = stagger(state, jax.random.key(2), PPOConfig(episode_length=10, decision_steps=steps)).info
    assert set(np.asarray(info["steps"])) == set(starts)
    assert info["steps"].dtype == np.int32
    assert info["boxes"] is nothing
