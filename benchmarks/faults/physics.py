"""Random actions on every task and variant: how often does physics leave the finite numbers?

Actions are held for up to half a second, and half of them are at the ends of their range, as no policy would choose
them. Counted are physics steps, sub-steps included, and environments that the training's guard (`wrappers.AutoReset`)
had to restart.
"""

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp

from graphrl_jax.encoder.pooling import PoolingParams
from graphrl_jax.registry import make_task
from graphrl_jax.rl.batch import vectorise
from graphrl_jax.rl.config import PPOConfig
from graphrl_jax.rl.wrappers import EnvironmentReward
from graphrl_jax.runtime import jit_physics

NUM_ENVS, CONTROL_STEPS, HELD = 512, 500, 10
"""Of a chunk: environments, control steps of each, and the longest time that an action is held."""


def random_steps(name: str, seed: int, engine: str | None = None) -> dict[str, int]:
    """A chunk of random actions on one task; a second chunk of the same task compiles nothing.

    Returns:
      `steps`, physics steps; `bad`, those after which the guard restarted an environment.
    """
    task, run = _program(name, engine)
    bad = run(jax.random.key(seed))
    return {"steps": NUM_ENVS * CONTROL_STEPS * task.physics.substeps, "bad": int(bad)}


_made: dict[tuple[str, str | None], tuple[Any, Any]] = {}


def _program(name: str, engine: str | None) -> tuple[Any, Any]:
    if (name, engine) not in _made:
        task = make_task(name, engine)
        config = PPOConfig(num_envs=NUM_ENVS, num_minibatches=1, episode_length=task.episode_length)
        env = vectorise(EnvironmentReward(task, PoolingParams()), config)
        _made[name, engine] = task, jit_physics(partial(_chunk, env, task.action_size))
    return _made[name, engine]


def _chunk(env: Any, action_size: int, key: jax.Array) -> jax.Array:
    """The number of bad steps in a chunk; ()."""
    reset_key, first_key, step_key = jax.random.split(key, 3)
    shape = (NUM_ENVS, action_size)

    def step(carry: tuple[Any, jax.Array], key: jax.Array) -> tuple[tuple[Any, jax.Array], jax.Array]:
        state, action = carry
        renew_key, edge_key, action_key = jax.random.split(key, 3)
        drawn = jax.random.uniform(action_key, shape, minval=-1.0, maxval=1.0)
        drawn = jnp.where(jax.random.bernoulli(edge_key, 0.5, shape), jnp.sign(drawn), drawn)
        renewed = jax.random.bernoulli(renew_key, 2 / HELD, (NUM_ENVS, 1))
        action = jnp.where(renewed, drawn, action)
        state = env.step(state, action)
        return (state, action), jnp.sum(state.metrics["bad_envs"])

    start = env.reset(jax.random.split(reset_key, NUM_ENVS)), jax.random.uniform(first_key, shape, minval=-1.0)
    _, bad = jax.lax.scan(step, start, jax.random.split(step_key, CONTROL_STEPS))
    return jnp.sum(bad)
