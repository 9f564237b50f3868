"""The states along the expert's successes that training episodes start from."""

import jax
import jax.numpy as jnp

from graphrl_jax.encoder.pooling import PoolingParams
from graphrl_jax.graph import activity
from tasks.shoes_in_box import expert
from tasks.shoes_in_box.env import ShoesInBoxEnv
from tasks.shoes_in_box.starts import Starts, ends_of
from tasks.shoes_in_box.state import success

EPISODES = 64


def make_starts(task: ShoesInBoxEnv, key: jax.Array, pooling: PoolingParams) -> Starts:
    """Runs the expert on `EPISODES` layouts; not compiled.

    An episode that fails is replaced by one that succeeds. If none succeeds, the starts are along failures.

    Args:
      task: the environment.
      key: randomness.
      pooling: `tau` and `activity` define activity.
    """
    states, _ = expert.episodes(task, key, jnp.zeros(EPISODES, jnp.int32))
    solved = jax.vmap(success)(jax.tree.map(lambda leaf: leaf[:, -1], states))
    # The successes first, again from the first one when they are used up.
    chosen = jnp.argsort(~solved)[jnp.arange(EPISODES) % jnp.maximum(jnp.sum(solved), 1)]
    states = jax.tree.map(lambda leaf: leaf[chosen], states)
    boxes, mask, _ = expert.seen(task, states)
    active = jax.vmap(lambda *frames: activity(*frames, pooling.tau, pooling.activity))(boxes, mask)
    return Starts(states, active, jax.vmap(ends_of)(states))
