"""Match Regions as a task: the environment with its expert, audit scenes and drawings."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, Self

import jax
import numpy as np

from graphrl_jax.demonstrations import Demonstrations
from graphrl_jax.perception.detector import Detector
from graphrl_jax.reward.landscape import Landscape
from graphrl_jax.task import Expert, Task
from tasks.match_regions import expert, layouts, magical, raster, render, scenes
from tasks.match_regions.env import MatchRegionsEnv
from tasks.match_regions.objects import scene_of_boxes
from tasks.match_regions.state import PhysicsState


class MatchRegions(MatchRegionsEnv, Task):
    """See `MatchRegionsEnv` for the arguments."""

    # Blocks may be brought in any order. With a larger exponent, some policies bring one target and leave it at that.
    pretrain_overrides: Mapping[str, float] = MappingProxyType({"in_order": 0.0, "even": 0.0, "exponent": 0.25})

    def training(self, starts: Any = None) -> Self:
        if self.control == "discrete":
            raise ValueError("policies act continuously; allowed: control 'continuous'")
        return self.changed(layout=layouts.Training(self.layout, self.varied))

    def image(self, physics: PhysicsState, size: int) -> jax.Array:
        return raster.image(physics.qpos, physics.world, size)

    def draw_boxes(
        self, boxes: jax.Array, mask: jax.Array, class_ids: jax.Array, turns: jax.Array, size: int
    ) -> jax.Array:
        return raster.image(*scene_of_boxes(self.objects, boxes, mask, class_ids, turns), size)

    def detector(self) -> Detector | None:
        # The detector knows only the classes of the Demo scene's table.
        return magical.detector() if self.layout.fixed else None

    def demonstrate(
        self, key: jax.Array, successes: int, failures: int = 0, image_size: int | None = None
    ) -> Demonstrations:
        return expert.demonstrate(self.changed(control="continuous"), key, successes, failures, image_size)

    def expert(self) -> Expert:
        return expert.as_policy()

    def draw_episode(
        self, states: Any, boxes: np.ndarray, mask: np.ndarray, active: np.ndarray, rewards: np.ndarray, label: str
    ) -> np.ndarray:
        return render.episode_frames(states.qpos, states.world, boxes, mask, active, rewards, size=320, label=label)

    def draw(self, physics: PhysicsState) -> np.ndarray:
        return render.draw_scene(*jax.tree.map(np.asarray, (physics.qpos, physics.world)), size=320)

    def landscape(self, key: jax.Array) -> Landscape:
        return scenes.landscape(self, key)
