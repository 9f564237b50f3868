"""Tasks by name, those of other packages included."""

import pytest

from graphrl_jax.registry import make_task, task_names
from graphrl_jax.task import Task

pytestmark = pytest.mark.usefixtures("outside_package")


def test_tasks_of_every_installed_package_are_found_by_name():
    names = task_names()
    assert names == sorted(names) and {"carry", "match_regions", "shoes_in_box"} <= set(names)
    for name in ("carry", "match_regions_colour"):
        task = make_task(name)
        assert isinstance(task, Task) and task.name == name


def test_an_unknown_task_lists_the_known_ones():
    with pytest.raises(ValueError, match="unknown task 'juggling'; known tasks: carry, match_regions, "):
        make_task("juggling")
