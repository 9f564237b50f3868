"""Rollouts of a fixed policy: the outcomes of episodes or all their frames, each in one compiled program."""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from brax.envs.base import State
from brax.envs.wrappers.training import VmapWrapper

from graphrl_jax.demonstrations import reached_for_good
from graphrl_jax.rl.actors import Actor, network
from graphrl_jax.rl.config import PPOConfig
from graphrl_jax.rl.ppo import OUTCOMES, MakeEnv
from graphrl_jax.rl.wrappers import episodic, observed
from graphrl_jax.runtime import jit_physics
from graphrl_jax.task import Task


def episode_outcomes(
    config: PPOConfig,
    make_env: MakeEnv,
    reward_params: Any,
    policy_params: Any,
    key: jax.Array,
    num_episodes: int,
    deterministic: bool = True,
    events: Callable[[State], jax.Array] | None = None,
    make_actor: Callable[[Any], Actor] | None = None,
) -> dict[str, jax.Array]:
    """Outcomes of one episode in each of `num_episodes` environments, from new resets, side by side. Pure.

    Args:
      config: configuration of the training run; sets the networks' sizes and the episode's length.
      make_env, reward_params: as for `ppo.init`; they define the reward of the return.
      policy_params: see `ppo.policy_params`.
      key: typed key; the same key gives the same episodes.
      num_episodes: static.
      deterministic: act by the distribution's mode instead of a sample; static.
      events: function from a state to (E,) bool, such as `Task.events`; static.
      make_actor: makes what acts of `policy_params`; default: the network of `config`; static.

    Returns:
      (num_episodes,) float32 for each of `ppo.OUTCOMES` that the environment reports: `success` and `score` of the
      last state, `episode_return`, `episode_length`. With `events`, also those of the last state: (num_episodes, E).
    """
    env = VmapWrapper(episodic(make_env(reward_params), config))
    reset_key, act_key = jax.random.split(key)
    state = env.reset(jax.random.split(reset_key, num_episodes))
    actor = (make_actor or partial(network, config, env.action_size, deterministic))(policy_params)
    act_keys = jax.random.split(act_key, config.episode_length // config.decision_steps + 1)

    def outcomes_of(state: State) -> dict[str, jax.Array]:
        found = {name: state.metrics[name] for name in OUTCOMES if name in state.metrics}
        return found if events is None else {**found, "events": jax.vmap(events)(state)}

    def choose(running: jax.Array, new: Any, old: Any) -> Any:
        return jax.tree.map(partial(jnp.where, running), new, old)

    def step(carry: tuple, key: jax.Array) -> tuple:
        state, memory, running, outcomes = carry
        memory, action = actor.act(memory, state, key)
        state = env.step(_not_done(state), action)
        # Steps after the end of an episode are ignored.
        outcomes = jax.vmap(choose)(running, outcomes_of(state), outcomes)
        return (state, memory, running & (state.done == 0), outcomes), None

    memory = actor.begin(state, act_keys[-1])
    carry = (_not_done(state), memory, jnp.ones(num_episodes, bool), outcomes_of(state))
    (*_, outcomes), _ = jax.lax.scan(step, carry, act_keys[:-1])
    return outcomes


_STATIC = ("config", "make_env", "num_episodes", "deterministic", "events", "make_actor")
evaluate = jit_physics(episode_outcomes, static_argnames=_STATIC)
"""`episode_outcomes`, compiled. Inside another compiled program use `episode_outcomes`: it sets no compiler options."""


def _not_done(state: State) -> State:
    return state.replace(done=jnp.zeros_like(state.done))


class Rollout(NamedTuple):
    """All frames of B episodes.

    | field   | shape        | dtype   | meaning                                                        |
    |---------|--------------|---------|----------------------------------------------------------------|
    | states  | (B, T, ...)  |         | leaves of the task's physics states                            |
    | boxes   | (B, T, N, 4) | float32 | boxes in the graph                                             |
    | mask    | (B, T, N)    | bool    | slots that are filled                                          |
    | active  | (B, T, N)    | bool    | slots that have moved                                          |
    | rewards | (B, T)       | float32 | the reward of the environment                                  |
    | events  | (B, E)       | int32   | first frame from which each event held to the end, -1 for none |
    """

    states: Any
    boxes: np.ndarray
    mask: np.ndarray
    active: np.ndarray
    rewards: np.ndarray
    events: np.ndarray


def record(
    task: Task,
    config: PPOConfig,
    make_env: MakeEnv,
    reward_params: Any,
    policy_params: Any,
    key: jax.Array,
    episodes: int,
    make_actor: Callable[[Any], Actor] | None = None,
) -> Rollout:
    """Runs whole episodes of the deterministic policy, or of another actor, and keeps every frame.

    Args:
      task: task of the episodes; sets their length and events.
      config, make_env, reward_params, policy_params, key, make_actor: see `episode_outcomes`.
      episodes: number of episodes.

    Returns:
      All frames on the host, see `Rollout`.
    """

    found = record_frames(task, config, make_env, reward_params, policy_params, key, episodes, make_actor)
    *frames, events = jax.tree.map(np.asarray, found)
    return Rollout(*frames, events=reached_for_good(events))


@partial(jit_physics, static_argnames=("task", "config", "make_env", "episodes", "make_actor"))
def record_frames(
    task: Task,
    config: PPOConfig,
    make_env: MakeEnv,
    reward_params: Any,
    policy_params: Any,
    key: jax.Array,
    episodes: int,
    make_actor: Callable[[Any], Actor] | None = None,
) -> tuple[Any, ...]:
    """The program of `record`: the fields of `Rollout`, with every frame's events (B, T, E) bool."""
    env = VmapWrapper(observed(make_env(reward_params), config))
    actor = (make_actor or partial(network, config, env.action_size, True))(policy_params)
    keys = jax.random.split(key, episodes + 1)
    act_keys = jax.random.split(keys[-1], task.episode_length // config.decision_steps + 1)
    state = env.reset(keys[:-1])

    def decide(carry: tuple, key: jax.Array) -> Any:
        state, memory = carry
        memory, action = actor.act(memory, state, key)
        state, frames = jax.lax.scan(partial(control, action), state, length=config.decision_steps)
        return (state, memory), frames

    def control(action: jax.Array, state: Any, _: None) -> Any:
        state = env.step(state, action)
        info = state.info
        frame = (state.pipeline_state, info["boxes"], info["mask"], info["active"], state.reward)
        return state, (*frame, jax.vmap(task.events)(state))

    _, frames = jax.lax.scan(decide, (state, actor.begin(state, act_keys[-1])), act_keys[:-1])
    return jax.tree.map(lambda leaf: leaf.reshape(-1, *leaf.shape[2:]).swapaxes(0, 1), frames)


def draw_rollout(task: Task, rollout: Rollout) -> np.ndarray:
    """Video frames of the episodes one after the other, drawn by the task: (frames, H, W, 3) uint8."""
    episodes = [
        task.draw_episode(
            jax.tree.map(lambda leaf, i=i: leaf[i], rollout.states),
            rollout.boxes[i],
            rollout.mask[i],
            rollout.active[i],
            rollout.rewards[i],
            f"episode {i + 1}",
        )
        for i in range(len(rollout.rewards))
    ]
    return np.concatenate(episodes)
