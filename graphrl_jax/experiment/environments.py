"""The training environment of each method."""

from collections.abc import Callable
from functools import cache, partial
from typing import Any, NamedTuple

import jax

from graphrl_jax.experiment.methods import method_named
from graphrl_jax.reward.landscape import DrawImage
from graphrl_jax.reward.model import RewardModel
from graphrl_jax.rl.wrappers import WRAPPERS, EnvironmentReward
from graphrl_jax.task import Task


@cache
def environment_of(task: Task, reward: str) -> Callable[[Any], EnvironmentReward]:
    """The function from reward parameters to an environment; parameters are a `RewardModel`, or `PoolingParams` for
    `env`.

    Cached: compiled programs are keyed by this function, so a task and reward must always give the same one.
    """
    wrapper = WRAPPERS[method_named(reward).needs]
    return lambda reward_params: wrapper(task, reward_params)


def reward_like(model: RewardModel) -> str:
    """A reward of `METHODS` with the input of a reward model, for a model whose method is not known."""
    return "graph" if model.image_size is None else "xirl"


class TrainingParams(NamedTuple):
    """Parameters of a training environment: those of the reward, and the task's `training_starts`."""

    reward: Any
    starts: Any


@cache
def training_environment_of(task: Task, reward: str) -> Callable[[TrainingParams], EnvironmentReward]:
    """As `environment_of`, with the starts of policy training; a function from `TrainingParams` to an environment."""
    wrapper = WRAPPERS[method_named(reward).needs]
    return lambda params: wrapper(task.training(params.starts), params.reward)


def refuse_undrawn(task: Task, reward: str) -> None:
    """Checks early that the task draws images, if the reward needs them.

    Raises:
      ValueError: the reward needs images, and the task has no `image`.
    """
    if method_named(reward).needs == "images":
        jax.eval_shape(lambda key: task.image(task.reset(key).pipeline_state, 8), jax.random.key(0))


def image_drawer(task: Task, model: RewardModel) -> DrawImage | None:
    """The function that draws a state for a reward from images; None for a reward from graphs."""
    return None if model.image_size is None else _image_drawer(task, model.image_size)


@cache
def _image_drawer(task: Task, size: int) -> DrawImage:
    """Cached: compiled programs are keyed by this function, so a task and size must always give the same one."""
    return partial(task.image, size=size)
