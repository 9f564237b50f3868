"""The training environment of each method."""

from collections.abc import Callable
from functools import cache, partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from graphrl_jax.experiment.methods import method_named
from graphrl_jax.experiment.settings import Settings
from graphrl_jax.pretrain.trainer import DrawBoxes
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


def refuse_undrawn(task: Task, reward: str, rearranged: float = 0.0) -> None:
    """Checks early that the task draws images, if the reward needs them, and those of rearrangements.

    Args:
      task: task of the run.
      reward: name of a row in `methods.METHODS`.
      rearranged: share of rearranged demonstrations.

    Raises:
      ValueError: the reward needs images, and the task has no `image`; or `draw_boxes`, for rearranged demonstrations.
    """
    if method_named(reward).needs != "images":
        return
    jax.eval_shape(lambda key: task.image(task.reset(key).pipeline_state, 8), jax.random.key(0))
    if rearranged > 0:
        slots = task.objects.num_slots
        shapes = [(slots, 4), (slots,), (slots,), (slots,)]
        kinds = [np.float32, bool, np.int32, np.float32]
        scene = map(jax.ShapeDtypeStruct, shapes, kinds)
        jax.eval_shape(partial(task.draw_boxes, size=8), *scene)


def image_drawer(task: Task, model: RewardModel) -> DrawImage | None:
    """The function that draws a state for a reward from images; None for a reward from graphs."""
    return None if model.image_size is None else _image_drawer(task, model.image_size)


@cache
def _image_drawer(task: Task, size: int) -> DrawImage:
    """Cached: compiled programs are keyed by this function, so a task and size must always give the same one."""
    return partial(task.image, size=size)


@cache
def box_drawer(task: Task, size: int) -> DrawBoxes:
    """The function that draws rearranged demonstrations as images of `size` pixels. Cached, as `_image_drawer` is."""

    def draw(boxes: jax.Array, mask: jax.Array, class_ids: jax.Array, turns: jax.Array) -> jax.Array:
        return jnp.round(255 * task.draw_boxes(boxes, mask, class_ids, turns, size)).astype(jnp.uint8)

    return draw


def drawer_of(task: Task, settings: Settings) -> DrawBoxes | None:
    """`box_drawer` for a reward from images that learns from rearrangements; None for others."""
    size = settings.image_size
    return None if size is None or settings.pretrain.rearranged == 0 else box_drawer(task, size)
