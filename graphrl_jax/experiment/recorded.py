"""A task that is known from recordings alone: no simulator, no expert, and an audit on rearranged demonstrations."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from brax.envs.base import State

from graphrl_jax.demonstrations import Demonstrations
from graphrl_jax.pretrain.augment import Chances, motion, rearrange
from graphrl_jax.pretrain.config import PretrainHyper
from graphrl_jax.registry import make_task, task_names
from graphrl_jax.reward.landscape import Landscape, Scenes
from graphrl_jax.task import Task

SCENES = 256
"""Rearrangements that an audit draws."""
_LATEST = 0.8
"""Unfinished scenes are up to this share of a rearrangement's time."""
_NEARLY = 0.95
"""Time at which the last object is not yet where it belongs."""


class RecordedTask(Task):
    """A task of which there are demonstrations alone, so that rewards score recordings and train no policies.

    Args:
      demonstrations: they say what the task's objects are; the audit rearranges the successes.
    """

    # People reach for objects as slowly as they bring them, and rest at the end: an encoder has to see both. Progress
    # should rise evenly.
    pretrain_overrides: Mapping[str, float] = MappingProxyType({"rearranged": 0.5, "approach": 1.0, "even": 1.0})

    def __init__(self, demonstrations: Demonstrations):
        self.name, self.objects = demonstrations.task, demonstrations.objects
        self.frame_rate, self.episode_length = demonstrations.frame_rate, demonstrations.num_frames
        self.event_names = demonstrations.event_names
        self._demonstrations = demonstrations

    def landscape(self, key: jax.Array) -> Landscape:
        """Scenes from rearrangements: their time stands for the true distance, and there are no grids."""
        demos, hyper = self._demonstrations.successes(), PretrainHyper(**self.pretrain_overrides)
        motions = jax.vmap(lambda *one: motion(*one, hyper.tau))(demos.boxes, demos.mask, demos.lengths)
        chosen_key, time_key, draw_key = jax.random.split(key, 3)
        chosen = jax.random.randint(chosen_key, (SCENES,), 0, len(demos))
        early = jax.random.uniform(time_key, (SCENES,), maxval=_LATEST)
        times = jnp.stack([early, jnp.full(SCENES, _NEARLY), jnp.ones(SCENES)], axis=1)
        chances = Chances(hyper.bumped, 0.0, hyper.approach, hyper.in_order, hyper.tau)

        def scene(number: jax.Array, times: jax.Array, key: jax.Array) -> tuple[jax.Array, jax.Array]:
            moves = jax.tree.map(lambda leaf: leaf[number], motions)
            return rearrange(key, demos.objects, moves, times, chances)

        boxes, active = jax.jit(jax.vmap(scene))(chosen, times, jax.random.split(draw_key, SCENES))
        unfinished, nearly, finished = (
            Scenes(np.asarray(boxes[:, number]), np.asarray(active[:, number])) for number in range(3)
        )
        return Landscape(
            objects=demos.objects,
            mask=demos.mask.any((0, 1)),
            grids=(),
            random=unfinished,
            random_distance=1.0 - np.asarray(early),
            finished=finished,
            unfinished=unfinished,
            within=finished,
            beside=nearly,
        )

    def reset(self, rng: jax.Array) -> State:
        raise ValueError(self._no_simulator())

    def step(self, state: State, action: jax.Array) -> State:
        raise ValueError(self._no_simulator())

    def boxes(self, state: State) -> tuple[jax.Array, jax.Array]:
        raise ValueError(self._no_simulator())

    def events(self, state: State) -> jax.Array:
        raise ValueError(self._no_simulator())

    def training(self, starts: Any = None) -> Task:
        raise ValueError(self._no_simulator())

    def demonstrate(
        self, key: jax.Array, successes: int, failures: int = 0, image_size: int | None = None
    ) -> Demonstrations:
        raise ValueError(self._no_simulator())

    def draw_episode(
        self, states: Any, boxes: np.ndarray, mask: np.ndarray, active: np.ndarray, rewards: np.ndarray, label: str
    ) -> np.ndarray:
        raise ValueError(self._no_simulator())

    @property
    def observation_size(self) -> int:
        raise ValueError(self._no_simulator())

    @property
    def action_size(self) -> int:
        raise ValueError(self._no_simulator())

    def _no_simulator(self) -> str:
        return f"task {self.name} is known from recordings alone; policies need a task with a simulator"


def task_of(demonstrations: Demonstrations) -> Task:
    """The registered task of demonstrations, or else one that is known from them alone."""
    if demonstrations.task in task_names():
        return make_task(demonstrations.task)
    return RecordedTask(demonstrations)
