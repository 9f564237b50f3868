"""A task that is known from recordings alone is audited on rearrangements and refuses what needs a simulator."""

import jax
import numpy as np
import pytest

from graphrl_jax.demonstrations import Demonstrations
from graphrl_jax.experiment.recorded import SCENES, RecordedTask, task_of
from graphrl_jax.graph import ObjectTable
from graphrl_jax.registry import make_task

OBJECTS = ObjectTable(
    ("hand", "cup", "shelf"), (0, 1, 2), (True, False, False), ("hand", "cup", "shelf"), (False, False, True)
)


def brought(task: str = "cups", count: int = 3, frames: int = 12) -> Demonstrations:
    """A hand brings a cup from the left to a shelf on the right."""
    share = np.linspace(0, 1, frames)
    boxes = np.full((count, frames, 3, 4), 0.1, np.float32)
    boxes[:, :, 1, :2] = np.stack([0.2 + 0.6 * share, np.full(frames, 0.5)], -1)
    boxes[:, :, 0, :2] = boxes[:, :, 1, :2] - 0.05
    boxes[:, :, 2] = (0.8, 0.5, 0.2, 0.2)
    lengths = np.full(count, frames, np.int32)
    return Demonstrations(
        boxes, np.ones((count, frames, 3), bool), lengths, np.ones(count, bool), OBJECTS, 10.0, "made up", task
    )


def test_an_audit_has_scenes_from_rearrangements():
    task = RecordedTask(brought())
    scenes = task.landscape(jax.random.key(0))
    assert scenes.random.boxes.shape == (SCENES, 3, 4) and scenes.mask.all() and not scenes.grids
    inside = np.abs(scenes.finished.boxes[:, 1, :2] - (0.8, 0.5)).max(-1) <= 0.1
    assert inside.all()
    away = np.abs(scenes.unfinished.boxes[:, 1, :2] - (0.8, 0.5)).max(-1) > 0.1
    assert away.mean() > 0.8
    assert (scenes.random_distance >= 0.2).all() and np.ptp(scenes.random_distance) > 0.7
    assert scenes.finished.active[:, 1].all() and not scenes.finished.active[:, 2].any()


def test_a_registered_task_is_built_and_another_is_known_from_its_demonstrations():
    assert isinstance(task_of(brought("match_regions")), type(make_task("match_regions")))
    task = task_of(brought())
    assert isinstance(task, RecordedTask)
    assert (task.name, task.frame_rate, task.episode_length, task.objects) == ("cups", 10.0, 12, OBJECTS)


def test_what_needs_a_simulator_is_refused():
    task = RecordedTask(brought())
    for call in (lambda: task.reset(jax.random.key(0)), lambda: task.demonstrate(jax.random.key(0), 1), task.training):
        with pytest.raises(ValueError, match="task cups is known from recordings alone; policies need a task with a"):
            call()
