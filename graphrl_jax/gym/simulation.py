"""The compiled programs behind the environments: a batch of them begins, steps and starts anew.

Symbols: B environments; O entries of the observation, which is the task's followed by N activity flags.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from brax.envs.base import Env, State

from graphrl_jax.experiment.environments import (
    TrainingParams,
    environment_of,
    refuse_undrawn,
    reward_like,
    training_environment_of,
)
from graphrl_jax.experiment.settings import compose
from graphrl_jax.pretrain.trainer import pooling_params
from graphrl_jax.registry import make_task
from graphrl_jax.reward.model import RewardModel
from graphrl_jax.rl.wrappers import MOST, AutoReset, Episode
from graphrl_jax.runtime import jit_physics
from graphrl_jax.task import Task

RATE_TOLERANCE = 0.005
"""Largest relative difference of frame rates that count as the same."""


class Frame(NamedTuple):
    """What the environments show after a reset or a step.

    | field      | shape  | dtype   | meaning                                                                     |
    |------------|--------|---------|-----------------------------------------------------------------------------|
    | obs        | (B, O) | float32 | observation, within `MOST` of 0                                             |
    | reward     | (B,)   | float32 | reward of the step; 0 after a reset                                         |
    | terminated | (B,)   | bool    | the task has ended the episode                                              |
    | truncated  | (B,)   | bool    | the time limit, or a state that is not finite, has ended it                 |
    | info       |        |         | by name: `success` (B,) bool; `score` (B,); `environment_reward` (B,), the  |
    |            |        |         | task's own; `events` (B, E) bool; `boxes` (B, N, 4), `mask` and `active`    |
    |            |        |         | (B, N) bool, see `EnvironmentReward`                                        |
    """

    obs: Any
    reward: Any
    terminated: Any
    truncated: Any
    info: dict[str, Any]


@dataclass(frozen=True)
class Simulation:
    """A task with a reward. Programs are compiled once per task, reward and B, and kept; see `make_simulation`.

    Attributes:
      task: the task.
      make_env: function from `params` to an environment, see `experiment.environments`.
      params: parameters of the reward, and the starts of training episodes.
      episode_length: control steps until an episode is truncated.
    """

    task: Task
    make_env: Callable[[Any], Env]
    params: Any
    episode_length: int

    @property
    def observation_size(self) -> int:
        """O."""
        return self.task.observation_size + self.task.objects.num_slots

    def begin(self, seeds: np.ndarray) -> tuple[State, Frame]:
        """First states of environments with the seeds (B,) uint32."""
        return self._on_host(_begin(*self._static, self.params, seeds))

    def advance(self, state: State, actions: np.ndarray) -> tuple[State, Frame]:
        """The next states, of episodes that may have ended, under actions (B, A) float32."""
        return self._on_host(_advance(*self._static, self.params, state, actions))

    def renew(self, state: State) -> tuple[State, Frame]:
        """First states of the next episodes, whatever the present ones are at."""
        return self._on_host(_renew(*self._static, self.params, state))

    def advance_and_renew(self, state: State, actions: np.ndarray) -> tuple[State, Frame, Frame]:
        """As `advance`, then `renew` where an episode has ended: the states, the frames before and after `renew`."""
        return self._on_host(_advance_and_renew(*self._static, self.params, state, actions))

    @property
    def _static(self) -> tuple:
        return self.task, self.make_env, self.episode_length

    @staticmethod
    def _on_host(found: tuple) -> tuple:
        """Frames as arrays of their own, which may be written to; the states stay on the device."""
        state, *frames = found
        return (state, *jax.tree.map(np.array, frames))


def make_simulation(
    task: str,
    reward_model: RewardModel | str | Path | None,
    engine: str | None,
    training: bool,
    most_steps: int | None = None,
) -> Simulation:
    """The simulation of a registered task.

    Args:
      task: registered name.
      reward_model: a reward model with a card, or its folder; None for the task's own reward.
      engine: name of the physics engine; None takes the fastest on this device.
      training: draw the starts of policy training, many of which are nearer to the goal.
      most_steps: an episode is truncated after so many steps, if the task does not do so before; None: no other limit.

    Raises:
      ValueError: the task, the engine or the folder is unknown, the reward model is one of other objects or of another
        frame rate, or a number is out of range.
    """
    made = _task(task, engine)
    if most_steps is not None and most_steps < 1:
        raise ValueError(f"max_episode_steps is {most_steps}; allowed: 1 or more")
    length = made.episode_length if most_steps is None else min(most_steps, made.episode_length)
    settings = compose(made, "env")
    pooling = jax.tree.map(np.float32, pooling_params(settings.pretrain_config, settings.pretrain))
    reward, params = "env", pooling
    if reward_model is not None:
        model = reward_model if isinstance(reward_model, RewardModel) else RewardModel.load(reward_model)
        refuse_other(model, made)
        reward = reward_like(model)
        refuse_undrawn(made, reward)
        # Programs are the same for all cards.
        params, pooling = replace(model, card=None), model.pooling
    if not training:
        return Simulation(made, environment_of(made, reward), params, length)
    starts = jit_physics(made.training_starts)(jax.random.key(0), pooling)
    return Simulation(made, training_environment_of(made, reward), TrainingParams(params, starts), length)


def refuse_other(model: RewardModel, task: Task) -> None:
    """Checks that a reward model is one of a task's objects and frame rate.

    Raises:
      ValueError: it is not, or it has no card.
    """
    card = model.card
    if card is None:
        raise ValueError("reward_model has no card that tells its objects; allowed: what RewardModel.load returns")
    if card.objects != task.objects:
        theirs, ours = (", ".join(objects.names) for objects in (card.objects, task.objects))
        raise ValueError(f"reward_model is of the objects {theirs}; task {task.name} has {ours}")
    if not math.isclose(card.frame_rate, task.frame_rate, rel_tol=RATE_TOLERANCE):
        raise ValueError(f"reward_model takes {card.frame_rate:g} frames per second; allowed: {task.frame_rate:g}")


@cache
def _task(name: str, engine: str | None) -> Task:
    """Cached: compiled programs are keyed by the task."""
    return make_task(name, engine)


_program = partial(jit_physics, static_argnums=(0, 1, 2))


@_program
def _begin(
    task: Task, make_env: Callable[[Any], Env], length: int, params: Any, seeds: jax.Array
) -> tuple[State, Frame]:
    env = AutoReset(Episode(make_env(params), length))
    state = jax.vmap(lambda seed: env.reset(jax.random.key(seed)))(seeds)
    return state, _frame(task, state)


@_program
def _advance(
    task: Task, make_env: Callable[[Any], Env], length: int, params: Any, state: State, actions: jax.Array
) -> tuple[State, Frame]:
    env = AutoReset(Episode(make_env(params), length))
    state = jax.vmap(env.advance)(state, actions)
    return state, _frame(task, state)


@_program
def _renew(task: Task, make_env: Callable[[Any], Env], length: int, params: Any, state: State) -> tuple[State, Frame]:
    env = AutoReset(Episode(make_env(params), length))
    state = _next_episodes(env, state.replace(done=jnp.ones_like(state.done)))
    return state, _frame(task, state)


@_program
def _advance_and_renew(
    task: Task, make_env: Callable[[Any], Env], length: int, params: Any, state: State, actions: jax.Array
) -> tuple[State, Frame, Frame]:
    env = AutoReset(Episode(make_env(params), length))
    last = jax.vmap(env.advance)(state, actions)
    state = _next_episodes(env, last)
    return state, _frame(task, last), _frame(task, state)


def _next_episodes(env: AutoReset, last: State) -> State:
    """New episodes where one has ended. The start of an environment's k-th episode depends on its seed and k alone."""
    ended = last.done > 0
    state = jax.vmap(env.renew)(last)

    def unless_ended(results: Any) -> Any:
        return jax.tree.map(lambda leaf: jnp.where(ended, 0.0, leaf), results)

    info = {
        **state.info,
        "reset_key": jnp.where(ended, state.info["reset_key"], last.info["reset_key"]),
        "truncation": unless_ended(state.info["truncation"]),
    }
    reward, done, metrics = unless_ended((state.reward, state.done, state.metrics))
    return state.replace(reward=reward, done=done, metrics=metrics, info=info)


def _frame(task: Task, state: State) -> Frame:
    info, metrics = state.info, state.metrics
    ended, truncated = state.done > 0, info["truncation"] > 0
    shown = {
        "success": metrics["success"] > 0.5,
        "score": metrics["score"],
        "environment_reward": metrics["env_reward"],
        "events": jax.vmap(task.events)(state),
        **{name: info[name] for name in ("boxes", "mask", "active")},
    }
    # The last state of physics that has diverged is shown within the space of observations.
    obs = jnp.clip(jnp.nan_to_num(state.obs), -MOST, MOST)
    return Frame(obs, state.reward, ended & ~truncated, ended & truncated, shown)
