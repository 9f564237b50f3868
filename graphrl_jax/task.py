"""The interface of a task."""

from abc import abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, NamedTuple

import jax
import numpy as np
from brax.envs.base import Env, State

from graphrl_jax.demonstrations import Demonstrations
from graphrl_jax.encoder.pooling import PoolingParams
from graphrl_jax.graph import ObjectTable
from graphrl_jax.perception.detector import Detector
from graphrl_jax.reward.landscape import Landscape


@dataclass(frozen=True)
class TrainingSize:
    """Size of a policy training: PPO updates, and values of `PPOConfig` and `PPOHyper` fields that the task sets."""

    updates: int
    ppo: Mapping[str, Any]


class Expert(NamedTuple):
    """An expert that decides in every control step, written for one environment; both functions can be traced.

    Attributes:
      begin: (first state, key) -> its plan, any pytree.
      act: (plan, state, key) -> the next plan, and an action (A,).
    """

    begin: Callable[[State, jax.Array], Any]
    act: Callable[[Any, State, jax.Array], tuple[Any, jax.Array]]


class Task(Env):
    """A Brax environment that reports the boxes of its objects, with an expert that demonstrates the task.

    `reset(key)` draws a new start and runs no physics. `step(state, action)` takes actions (A,) in [-1, 1]. The reward
    is the environmental one, and `done` stays 0, because `wrappers.Episode` sets the time limit. `state.metrics` holds
    `success` and `score`. `reset` may add two entries to `state.info`: `active` (N,) bool, the objects that count as
    moved when an episode starts part of the way to the goal, and `class_ids` (N,) int32, the classes of the slots if
    they change between episodes. All methods are written for one environment.

    Attributes:
      name: registered name.
      objects: the object in each of the N node slots.
      event_names: (E,) names of the true events, each the end of a subtask.
      episode_length: control steps per episode.
      frame_rate: control steps per second.
      decision_steps: control steps per decision of the policy.
      retreat_action: (A,) action that moves the robot away from where it works, with whatever it holds; empty if there
        is none.
      pretrain_overrides: values of `PretrainHyper` fields for the task's demonstrations, such as 0 for `in_order` if
        objects may be brought in any order.
      training_sizes: sizes of policy training that replace those of a preset, by the preset's name.
    """

    name: str
    objects: ObjectTable
    event_names: tuple[str, ...]
    episode_length: int
    frame_rate: float
    decision_steps: int = 1
    retreat_action: tuple[float, ...] = ()
    pretrain_overrides: Mapping[str, float] = MappingProxyType({})
    training_sizes: Mapping[str, TrainingSize] = MappingProxyType({})

    @property
    def backend(self) -> str:
        return "mjx"

    @abstractmethod
    def boxes(self, state: State) -> tuple[jax.Array, jax.Array]:
        """Image-plane boxes (N, 4) and mask (N,) bool of a state."""

    def nodes(self, state: State) -> jax.Array:
        """Features of the objects of a state for policies that take them as a set: (M, F) float32.

        The first feature is 1 if the object is there, else 0; a policy may not depend on the objects' order.
        `state.info["active"]` tells which ones have moved.

        Raises:
          ValueError: the task has no such features.
        """
        raise ValueError(f"task {self.name} has no objects for a policy of a set; allowed: policy 'flat'")

    @abstractmethod
    def events(self, state: State) -> jax.Array:
        """Whether each event is reached in this state: (E,) bool."""

    @abstractmethod
    def demonstrate(
        self, key: jax.Array, successes: int, failures: int = 0, image_size: int | None = None
    ) -> Demonstrations:
        """Runs the expert for `successes` solved episodes and `failures` deliberate failures of every kind in turn.

        With `image_size`, the demonstrations hold an image of every frame, `image_size` pixels square.
        """

    def expert(self) -> Expert:
        """The expert as a policy, for `graphrl evaluate --policy expert`.

        Raises:
          ValueError: the task has none.
        """
        raise ValueError(f"task {self.name} has no expert that acts step by step; allowed: another policy")

    @abstractmethod
    def landscape(self, key: jax.Array) -> Landscape:
        """Scenes on which a learned reward is audited."""

    @abstractmethod
    def draw_episode(
        self, states: Any, boxes: np.ndarray, mask: np.ndarray, active: np.ndarray, rewards: np.ndarray, label: str
    ) -> np.ndarray:
        """Video frames of one episode, the scene with boxes and activity next to the reward: (T, H, W, 3) uint8.

        `states` is the physics state with leaves (T, ...), boxes (T, N, 4), mask and active (T, N), rewards (T,).
        """

    def draw(self, physics: Any) -> np.ndarray:
        """Drawing of a physics state, without boxes: (H, W, 3) uint8; default: a frame of `draw_episode`."""
        slots = self.objects.num_slots
        states = jax.tree.map(lambda leaf: np.asarray(leaf)[None], physics)
        boxes, absent = np.zeros((1, slots, 4), np.float32), np.zeros((1, slots), bool)
        return self.draw_episode(states, boxes, absent, absent, np.zeros(1, np.float32), "")[0]

    def image(self, physics: Any, size: int) -> jax.Array:
        """Camera image of a physics state: (size, size, 3) float32 in [0, 1]; can be traced.

        Raises:
          ValueError: the task draws no images, so policies cannot be trained on a reward from images.
        """
        raise ValueError(f"task {self.name} draws no images inside a program; allowed: rewards that need none")

    def draw_boxes(
        self, boxes: jax.Array, mask: jax.Array, class_ids: jax.Array, turns: jax.Array, size: int
    ) -> jax.Array:
        """Camera image of a scene that is known by its boxes alone, as rearranged demonstrations are; can be traced.

        Args:
          boxes: (N, 4) float32, image-plane boxes.
          mask: (N,) bool, objects that are there.
          class_ids: (N,) int32, their classes.
          turns: (N,) float32, angles of the objects in radians, which boxes do not tell.
          size: edge of the image in pixels (static).

        Returns:
          (size, size, 3) float32 in [0, 1].

        Raises:
          ValueError: the task cannot draw them.
        """
        raise ValueError(f"task {self.name} draws no images of boxes; allowed: pretrain.rearranged 0")

    def detector(self) -> Detector | None:
        """Detector of the task's objects in images, for the import of videos; None if only the user can supply one."""
        return None

    def training_starts(self, key: jax.Array, pooling: PoolingParams) -> Any:
        """Arrays that `training` draws starts from, made once before a training; None if it needs none. Can be traced.

        Args:
          key: randomness.
          pooling: `tau` and `activity` define activity along the way to a start.
        """
        return None

    def restart(self, rng: jax.Array, last: State) -> State:
        """The start of the next training episode, which may depend on how the one before ended.

        Args:
          rng: randomness.
          last: the state that ended the episode before. What it should remember lies in its `info`.
        """
        return self.reset(rng)

    @abstractmethod
    def training(self, starts: Any = None) -> "Task":
        """The same task with the reset distribution of policy training.

        Args:
          starts: as returned by `training_starts`; may be traced.
        """
