"""Shoes in Box as a task: the environment with its expert, audit scenes and drawings."""

import copy
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, Self

import jax
import numpy as np

from graphrl_jax.demonstrations import Demonstrations
from graphrl_jax.encoder.pooling import PoolingParams
from graphrl_jax.reward.landscape import Landscape
from graphrl_jax.task import Expert, Task, TrainingSize
from tasks.shoes_in_box import expert, render, scenes
from tasks.shoes_in_box.env import ShoesInBoxEnv
from tasks.shoes_in_box.starts import Starts
from tasks.shoes_in_box.state import PhysicsState
from tasks.shoes_in_box.training import make_starts

_PPO = {
    "unroll_length": 10,
    "num_epochs": 4,
    "initial_std": 0.4,
    "progress": True,
    "patience": 76,
    "retreat": 16,
    "activation": "swish",
    "policy_hidden": (256, 256),
    "value_hidden": (256, 256),
    "learning_rate": 4e-4,
    "final_learning_rate": 1e-4,
    "discount": 0.98,
    "entropy_cost": 0.006,
}


class ShoesInBox(ShoesInBoxEnv, Task):
    """See `ShoesInBoxEnv` for the arguments."""

    # With messages from the robot, the reward is a ramp instead of a staircase. With more time on ways to objects, it
    # hardly tells a shoe in the box from one beside it. With a larger exponent, the discounted reward of a shoe that is
    # held above the box until the end exceeds that of successes that took longer. The temperature is what
    # `benchmarks.tuning` chose.
    pretrain_overrides: Mapping[str, float] = MappingProxyType(
        {"robot_messages": 0.0, "approach": 0.02, "even": 0.0, "exponent": 0.25, "temperature": 1.0}
    )
    training_sizes: Mapping[str, TrainingSize] = MappingProxyType(
        {
            "cpu": TrainingSize(500, _PPO | {"num_envs": 512, "num_minibatches": 8}),
            "gpu": TrainingSize(340, _PPO | {"num_envs": 2048, "num_minibatches": 32, "learning_rate": 3e-4}),
        }
    )

    def training_starts(self, key: jax.Array, pooling: PoolingParams) -> Starts:
        return make_starts(self, key, pooling)

    def training(self, starts: Any = None) -> Self:
        other = copy.copy(self)
        other.starts = starts
        return other

    def demonstrate(
        self, key: jax.Array, successes: int, failures: int = 0, image_size: int | None = None
    ) -> Demonstrations:
        return expert.demonstrate(self, key, successes, failures, image_size)

    def draw(self, physics: PhysicsState) -> np.ndarray:
        return render.draw_scene(np.asarray(physics.qpos), np.asarray(physics.box), size=320)

    def expert(self) -> Expert:
        return expert.as_policy()

    def landscape(self, key: jax.Array) -> Landscape:
        return scenes.landscape(key)

    def draw_episode(
        self, states: Any, boxes: np.ndarray, mask: np.ndarray, active: np.ndarray, rewards: np.ndarray, label: str
    ) -> np.ndarray:
        return render.episode_frames(states.qpos, states.box, boxes, active, rewards, label)
