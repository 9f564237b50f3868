"""A batch of environments in which only those whose episode is over draw a new start."""

from typing import Any

import jax
import jax.numpy as jnp
from brax.envs.base import Env, State, Wrapper

from graphrl_jax.rl.config import PPOConfig
from graphrl_jax.rl.wrappers import AutoReset, Progress, deciding, limited

# With staggered starts about one environment in an episode's length begins anew in a step, so one round is enough.
_SHARE = 32
_LEAST = 8


class Batch(Wrapper):
    """B environments side by side: `reset` takes keys (B,), and `step` a batched state and actions (B, A).

    The states are those of `jax.vmap` of the environment, but for the starts that `AutoReset` draws and discards where
    an episode goes on. Here those that are over are picked out and begun anew, a fixed number in each round, as many
    rounds as it takes. A reset may therefore cost as much as many steps. The start of an environment's k-th episode
    depends on its key and k alone.
    """

    env: AutoReset

    def reset(self, rng: jax.Array) -> State:
        return jax.vmap(self.env.reset)(rng)

    def step(self, state: State, action: jax.Array) -> State:
        return self._renew(jax.vmap(self.env.advance)(state, action))

    def _renew(self, state: State) -> State:
        """New episodes where one is over."""
        number = state.done.shape[0]
        size = min(number, max(number // _SHARE, _LEAST))

        def some_wait(carry: tuple[State, jax.Array]) -> jax.Array:
            return jnp.any(carry[1])

        def renew_some(carry: tuple[State, jax.Array]) -> tuple[State, jax.Array]:
            state, waiting = carry
            # Places left over hold the number after the last environment, which is read as the last and never written.
            (chosen,) = jnp.nonzero(waiting, size=size, fill_value=number)
            fresh = jax.vmap(self.env.renew)(jax.tree.map(lambda leaf: leaf.at[chosen].get(mode="clip"), state))

            def put(leaf: jax.Array, new: jax.Array) -> Any:
                return leaf.at[chosen].set(new, mode="drop")

            return jax.tree.map(put, state, fresh), waiting.at[chosen].set(False, mode="drop")

        return jax.lax.while_loop(some_wait, renew_some, (state, state.done > 0))[0]


def vectorise(env: Env, config: PPOConfig) -> Batch:
    """The environment for a training loop: with time limit, progress, decisions, automatic reset and batch axis.

    `reset` takes keys (B,) and `step` a batched state and actions (B, A).
    """
    paid = limited(env, config)
    if config.progress:
        paid = Progress(paid, config.patience, config.retreat)
    return Batch(AutoReset(deciding(paid, config)))


def stagger(state: State, key: jax.Array, config: PPOConfig) -> State:
    """Draws a random step count for each environment, so that a batch of new episodes does not end all at once.

    Meant for the first reset of a training run: its first episodes are cut short, later ones are whole.
    """
    steps = state.info["steps"]
    decisions = config.episode_length // config.decision_steps
    drawn = jax.random.randint(key, steps.shape, 0, decisions, dtype=steps.dtype)
    return state.replace(info={**state.info, "steps": drawn * config.decision_steps})
