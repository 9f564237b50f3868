"""Tasks by name, those of other packages included."""

from types import SimpleNamespace

import pytest

from graphrl_jax import registry
from graphrl_jax.registry import make_task, task_names
from graphrl_jax.task import Task

pytestmark = pytest.mark.usefixtures("outside_package")


def test_tasks_of_every_installed_package_are_found_by_name():
    names = task_names()
    assert names == sorted(names) and {"carry", "match_regions", "shoes_in_box"} <= set(names)
    for name in ("carry", "match_regions_colour"):
        task = make_task(name)
        assert isinstance(task, Task) and task.name == name


def test_a_task_of_one_engine_takes_none():
    with pytest.raises(ValueError, match="task 'carry' has one engine of its own; leave the engine 'mjx' out"):
        make_task("carry", "mjx")


def test_an_unknown_task_lists_the_known_ones():
    with pytest.raises(ValueError, match="unknown task 'juggling'; known tasks: carry, match_regions, "):
        make_task("juggling")


@pytest.mark.parametrize(
    "attributes, message",
    [
        ({"name": "other"}, "task 'mine' has the name 'other'; allowed: the name that it is registered by"),
        ({"name": "mine", "picture": None}, "task 'mine' has an attribute 'picture', which is called 'image' now"),
        ({"name": "mine", "pretraining": None}, "'pretraining', which is called 'pretrain_overrides' now"),
    ],
)
def test_a_task_that_would_be_misread_is_refused(monkeypatch, attributes, message):
    point = SimpleNamespace(load=lambda: lambda: SimpleNamespace(**attributes))
    monkeypatch.setattr(registry, "entry_points", lambda **_: [point])
    with pytest.raises(ValueError, match=message):
        make_task("mine")
