"""What acts in an episode: a policy network, or a policy that has learned nothing and shows a task or a reward.

Symbols: B environments, A action size.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from brax.envs.base import State

from graphrl_jax.rl.config import POLICIES, PPOConfig
from graphrl_jax.rl.networks import make_inference
from graphrl_jax.task import Task


class Actor(NamedTuple):
    """Acts in B environments side by side; both functions can be traced.

    Attributes:
      begin: (first states, key) -> what it remembers, any pytree.
      act: (what it remembers, states, key) -> what it remembers then, and actions (B, A) in [-1, 1].
    """

    begin: Callable[[State, jax.Array], Any]
    act: Callable[[Any, State, jax.Array], tuple[Any, jax.Array]]


def network(config: PPOConfig, action_size: int, deterministic: bool, policy_params: Any) -> Actor:
    """The policy of a training; see `networks.make_inference`."""

    def act(memory: None, state: State, key: jax.Array) -> tuple[None, jax.Array]:
        infer = make_inference(config, state.obs.shape[-1], action_size, deterministic)
        return memory, infer(policy_params, state.obs, key)

    return Actor(_nothing, act)


def policy_named(name: str, task: Task) -> Actor:
    """One of `POLICIES` in a task: all actions 0, uniformly random ones, or those of the task's expert.

    Raises:
      ValueError: the name is unknown, or the task has no expert that acts.
    """
    match name:
        case "zero":
            return _without_memory(lambda batch, _: jnp.zeros((batch, task.action_size)))
        case "random":
            return _without_memory(lambda batch, key: _uniform(key, batch, task.action_size))
        case "expert":
            return _expert(task)
    raise ValueError(f"unknown policy {name!r}; known policies: {', '.join(POLICIES)}")


def _expert(task: Task) -> Actor:
    """The task's expert in every environment."""
    expert = task.expert()

    def begin(state: State, key: jax.Array) -> Any:
        return jax.vmap(expert.begin)(state, jax.random.split(key, len(state.done)))

    def act(memory: Any, state: State, key: jax.Array) -> tuple[Any, jax.Array]:
        return jax.vmap(expert.act)(memory, state, jax.random.split(key, len(state.done)))

    return Actor(begin, act)


def _without_memory(draw: Callable[[int, jax.Array], jax.Array]) -> Actor:
    """An actor whose actions are those of `draw`, of the number of environments and a key."""
    return Actor(_nothing, lambda memory, state, key: (memory, draw(len(state.done), key)))


def _uniform(key: jax.Array, batch: int, action_size: int) -> jax.Array:
    return jax.random.uniform(key, (batch, action_size), minval=-1.0, maxval=1.0)


def _nothing(state: State, key: jax.Array) -> None:
    """The memory of an actor that has none."""
