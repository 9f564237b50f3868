"""What makes the environment a task."""

import pytest

from graphrl_jax.registry import make_task
from graphrl_jax.task import Task
from tasks.match_regions import layouts
from tasks.match_regions.task import MatchRegions
from tests.helpers.match_regions import TASK


def test_training_keeps_what_the_task_was_told() -> None:
    task = MatchRegions(targets_in_order=False, varied=0.25).with_reward(reach=0.5).training()
    assert task.layout == layouts.Training(layouts.Demo(), 0.25)
    assert (task.targets_in_order, task.reward.reach) == (False, 0.5)


def test_policies_act_continuously():
    with pytest.raises(ValueError, match="policies act continuously"):
        MatchRegions(control="discrete").training()


def test_only_the_demo_scenes_objects_are_told_apart_by_colour():
    assert isinstance(TASK, Task) and TASK.detector() is not None
    assert make_task("match_regions_colour").detector() is None
