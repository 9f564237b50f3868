"""Shoes in Box as a task: the environment with its expert, audit scenes and drawings."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, Self

import jax
import numpy as np

from graphrl_jax.demonstrations import Demonstrations
from graphrl_jax.reward.landscape import Landscape
from graphrl_jax.task import Task
from tasks.shoes_in_box import expert, render, scenes
from tasks.shoes_in_box.env import ShoesInBoxEnv


class ShoesInBox(ShoesInBoxEnv, Task):
    """See `ShoesInBoxEnv` for the arguments."""

    # A lid does not move freely. With messages from the robot, the reward is a ramp instead of a staircase.
    pretrain_overrides: Mapping[str, float] = MappingProxyType({"rearranged": 0.0, "robot_messages": 0.0})

    def training(self) -> Self:
        return self

    def demonstrate(
        self, key: jax.Array, successes: int, failures: int = 0, image_size: int | None = None
    ) -> Demonstrations:
        return expert.demonstrate(self, key, successes, failures, image_size)

    def landscape(self, key: jax.Array) -> Landscape:
        return scenes.landscape(key)

    def draw_episode(
        self, states: Any, boxes: np.ndarray, mask: np.ndarray, active: np.ndarray, rewards: np.ndarray, label: str
    ) -> np.ndarray:
        return render.episode_frames(states.qpos, states.box, boxes, active, rewards, label)
