"""What a task hands over to everything else, and how tasks are found by name."""

from abc import abstractmethod
from importlib.metadata import entry_points
from typing import Any

import jax
import numpy as np
from brax.envs.base import Env, State

from graphrl_jax.demonstrations import Demonstrations
from graphrl_jax.detection import Detector
from graphrl_jax.graph import ObjectTable
from graphrl_jax.landscape import Landscape
from graphrl_jax.pretrain import PretrainHyper

ENTRY_POINT_GROUP = "graphrl_jax.tasks"


class Task(Env):
    """A Brax environment whose states can be seen as boxes, plus an expert that demonstrates it.

    `reset(key)` draws a fresh start and runs no physics; `step(state, action)` takes actions (A,) in [-1, 1]; the
    reward is the environment's own and `done` stays 0: the time limit belongs to `wrappers.Episode`.
    `state.metrics` holds `success` and `score`. Two things a `reset` may put into `state.info`: `active` (N,) bool,
    what counts as moved from the start, where an episode starts part of the way to the goal; and `class_ids` (N,)
    int32, what sits in the slots, where that changes between episodes. All methods are written for one environment.

    Attributes:
      name: registered name.
      objects: what sits in which of the N node slots.
      event_names: (E,) names of the true stage events.
      episode_length: control steps per episode.
      frame_rate: control steps per second.
      pretraining: floats that suit the task's demonstrations, such as `rearranged` 0 where objects do not move freely.
    """

    name: str
    objects: ObjectTable
    event_names: tuple[str, ...]
    episode_length: int
    frame_rate: float
    pretraining: PretrainHyper = PretrainHyper()

    @property
    def backend(self) -> str:
        return "mjx"

    @abstractmethod
    def boxes(self, state: State) -> tuple[jax.Array, jax.Array]:
        """Image-plane boxes (N, 4) and mask (N,) bool of a state."""

    @abstractmethod
    def events(self, state: State) -> jax.Array:
        """Whether each stage counts as reached in this state: (E,) bool."""

    @abstractmethod
    def demonstrate(
        self, key: jax.Array, successes: int, failures: int = 0, picture_size: int | None = None
    ) -> Demonstrations:
        """Runs the expert: `successes` solved episodes and `failures` deliberate ones of every kind in turn.

        With `picture_size` every frame's picture comes along, so many pixels square.
        """

    @abstractmethod
    def landscape(self, key: jax.Array) -> Landscape:
        """Scenes on which a learned reward is audited."""

    @abstractmethod
    def draw_episode(
        self, states: Any, boxes: np.ndarray, mask: np.ndarray, active: np.ndarray, rewards: np.ndarray, label: str
    ) -> np.ndarray:
        """Pictures of one episode, the scene with boxes and activity beside the reward so far: (T, H, W, 3) uint8.

        `states` is the physics state with leaves (T, ...), boxes (T, N, 4), mask and active (T, N), rewards (T,).
        """

    def picture(self, physics: Any, size: int) -> jax.Array:
        """What a camera sees of a physics state: (size, size, 3) float32 in [0, 1], to be traced.

        Raises:
          ValueError: this task has none; policies cannot be trained on a reward of pixels.
        """
        raise ValueError(f"task {self.name} cannot be drawn inside a program; rewards that need no picture can be used")

    def picture_detector(self) -> Detector | None:
        """What finds the task's objects in pictures, for the import of videos; None if only a user's model can."""
        return None

    @abstractmethod
    def training(self) -> "Task":
        """The same task with the reset distribution that policies are trained on."""


def task_names() -> list[str]:
    """Names of all registered tasks, sorted."""
    return sorted(point.name for point in entry_points(group=ENTRY_POINT_GROUP))


def make_task(name: str) -> Task:
    """Builds a registered task; packages register theirs in the entry point group `graphrl_jax.tasks`.

    Raises:
      ValueError: no task of that name; the message lists the known ones.
    """
    points = entry_points(group=ENTRY_POINT_GROUP, name=name)
    if not points:
        raise ValueError(f"unknown task {name!r}; known tasks: {', '.join(task_names()) or 'none'}")
    return next(iter(points)).load()()
