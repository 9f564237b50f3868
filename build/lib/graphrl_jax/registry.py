"""Tasks by name. Installed packages register them in the entry point group `graphrl_jax.tasks`."""

import inspect
from importlib.metadata import entry_points
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from graphrl_jax.task import Task

ENGINES = ("mjx", "mujoco", "warp")
"""Names of the physics engines that a task may offer."""
ENTRY_POINT_GROUP = "graphrl_jax.tasks"
_RENAMED = {"pretraining": "pretrain_overrides", "picture": "image", "picture_detector": "detector"}


def task_names() -> list[str]:
    """Sorted names of all registered tasks; no task is imported."""
    return sorted({point.name for point in entry_points(group=ENTRY_POINT_GROUP)})


def make_task(name: str, engine: str | None = None) -> "Task":
    """Builds a registered task.

    Args:
      name: registered name.
      engine: physics engine; None leaves the choice to the task.

    Raises:
      ValueError: no task has this name (the message lists the known tasks), the task calls itself otherwise, it was
        written for an earlier release, or it cannot use the engine.
    """
    points = entry_points(group=ENTRY_POINT_GROUP, name=name)
    if not points:
        raise ValueError(f"unknown task {name!r}; known tasks: {', '.join(task_names()) or 'none'}")
    make = next(iter(points)).load()
    if engine is None:
        task = make()
    elif "engine" in inspect.signature(make).parameters:
        task = make(engine=engine)
    else:
        raise ValueError(f"task {name!r} has one engine of its own; leave the engine {engine!r} out")
    if task.name != name:
        raise ValueError(f"task {name!r} has the name {task.name!r}; allowed: the name that it is registered by")
    for old, new in _RENAMED.items():
        if hasattr(task, old):
            raise ValueError(f"task {name!r} has an attribute {old!r}, which is called {new!r} now")
    return task
