"""The default rule of activity on the tasks' own demonstrations."""

from functools import cache

import jax
import numpy as np
import pytest

from graphrl_jax.demonstrations import Demonstrations
from graphrl_jax.graph import activity
from graphrl_jax.pretrain.config import PretrainHyper
from graphrl_jax.registry import make_task

TASK_OBJECTS = {"match_regions": ("star", "square"), "shoes_in_box": ("lid", "shoe_1", "shoe_2")}
"""What every success moves."""
FRAMES = 480
TAU = PretrainHyper().tau
ACTIVITY = jax.jit(jax.vmap(activity, in_axes=(0, 0, None)))

by_task = pytest.mark.parametrize("task", ["match_regions", pytest.param("shoes_in_box", marks=pytest.mark.slow)])


@cache
def successes(task: str) -> Demonstrations:
    return make_task(task).demonstrate(jax.random.key(0), 64)


def flags(demos: Demonstrations, every: int = 1) -> np.ndarray:
    """What is active at the end of each demonstration, if every so many-th frame is kept: (B, N)."""
    mask = demos.mask & (np.arange(demos.num_frames) < demos.lengths[:, None])[..., None]
    return np.asarray(ACTIVITY(demos.boxes[:, ::every], mask[:, ::every], TAU))[:, -1]


@by_task
def test_every_success_makes_its_task_objects_active_and_never_a_fixture(task):
    demos = successes(task)
    slots = [demos.objects.names.index(name) for name in TASK_OBJECTS[task]]
    found = flags(demos)
    assert found[:, slots].all(axis=1).mean() >= 0.99
    assert not found[:, list(demos.objects.is_fixture)].any()


@by_task
def test_a_slower_camera_sees_the_same_objects_move(task):
    demos = successes(task)
    for every in (2, 4):
        np.testing.assert_array_equal(flags(demos, every), flags(demos))


@by_task
@pytest.mark.parametrize("jitter", [0.02, 0.03])
def test_objects_at_rest_are_not_active_under_a_detectors_jitter(task, jitter):
    demos = successes(task).select(np.tile(np.arange(64), 4))
    still, seen = demos.boxes[:, :1], np.repeat(demos.mask[:, :1], FRAMES, axis=1)
    noise = np.random.default_rng(0).normal(size=(len(demos), FRAMES, *still.shape[2:]))
    shaken = still + jitter * np.tile(still[..., 2:], 2) * noise
    found = np.asarray(ACTIVITY(shaken.astype(np.float32), seen, TAU))[:, -1]
    assert found[seen[:, 0]].mean() <= 0.01
