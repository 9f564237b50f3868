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


def flags(demos: Demonstrations, every: int = 1, jitter: float = 0.0) -> np.ndarray:
    """What is active at the end of each demonstration, if every so many-th frame is kept, of boxes that are shaken by
    `jitter` of their sides: (B, N).
    """
    mask = demos.mask & (np.arange(demos.num_frames) < demos.lengths[:, None])[..., None]
    boxes = shaken(demos.boxes, jitter)
    return np.asarray(ACTIVITY(boxes[:, ::every], mask[:, ::every], TAU))[:, -1]


def shaken(boxes: np.ndarray, jitter: float) -> np.ndarray:
    """Boxes (..., 4) with noise, as a share of their sides."""
    noise = np.random.default_rng(0).normal(size=boxes.shape)
    return (boxes + jitter * np.tile(boxes[..., 2:], 2) * noise).astype(np.float32)


@by_task
@pytest.mark.parametrize("jitter", [0.0, 0.004])
def test_every_success_makes_its_task_objects_active_and_never_a_fixture(task, jitter):
    demos = successes(task)
    slots = [demos.objects.names.index(name) for name in TASK_OBJECTS[task]]
    found = flags(demos, jitter=jitter)
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
    boxes = shaken(np.repeat(still, FRAMES, axis=1), jitter)
    found = np.asarray(ACTIVITY(boxes, seen, TAU))[:, -1]
    assert found[seen[:, 0]].mean() <= 0.01


def filmed(frame_rate: int, rule: str) -> np.ndarray:
    """Activity in every half second of the same ten seconds, filmed at some rate: (20, 4).

    One object rests, one moves slowly from the first second on, one faster from the fourth, one there and back.
    """
    seconds = np.arange(10 * frame_rate) / frame_rate
    ways = (
        0 * seconds,
        0.02 * (seconds - 1).clip(0),
        0.1 * (seconds - 4).clip(0, 2),
        0.1 * np.sin(seconds * np.pi / 5),
    )
    boxes = np.full((len(seconds), len(ways), 4), 0.1, np.float32)
    boxes[..., 0] = 0.3 + np.stack(ways, axis=-1)
    mask = np.ones(boxes.shape[:2], bool)
    found = jax.jit(activity, static_argnums=3)(boxes, mask, TAU if rule == "displacement" else 0.02, rule)
    return np.asarray(found)[:: frame_rate // 2]


@pytest.mark.parametrize("frame_rate", [8, 20, 30, 60])
def test_the_same_motion_is_active_at_every_frame_rate(frame_rate):
    found = filmed(frame_rate, "displacement")
    np.testing.assert_array_equal(found, filmed(120, "displacement"))
    np.testing.assert_array_equal(found[-1], [False, True, True, True])
    # The slow one has moved 0.15 diagonals of 0.14 after a second of rest and 1.06 seconds of way.
    np.testing.assert_array_equal(found[:, 1], np.arange(20) >= 5)


def test_the_old_rule_depends_on_the_frame_rate():
    assert (filmed(8, "frame_motion") != filmed(60, "frame_motion")).any()
