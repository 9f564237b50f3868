"""The command that repeats a run, from the run's settings."""

import shlex
from typing import Any

from graphrl_jax import demonstrations
from graphrl_jax.cli.options import option
from graphrl_jax.cli.requests import RESOLVED, STOP_AT
from graphrl_jax.experiment.methods import ABLATIONS
from graphrl_jax.experiment.recorded import task_of
from graphrl_jax.experiment.settings import Settings, compose
from graphrl_jax.registry import make_task
from graphrl_jax.task import Task

_COMMON = ("task", "reward", "preset", "seed", "demos", "engine")
_OF_COMMANDS = {"train": _COMMON, "pretrain": ("demos", "reward", "seed")}


def repeating(settings: Settings, command: str, out: str) -> tuple[str, str]:
    """The command that repeats a run, and what there is to say about it.

    Args:
      settings: of the run.
      command: that made it, `train` or `pretrain`.
      out: folder of the repetition.

    Returns:
      The command, an option per line, and one sentence; empty if the command gives exactly these settings.
    """
    options: dict[str, Any] = {name: getattr(settings, name) for name in _OF_COMMANDS[command]}
    note = ""
    try:
        options |= _own(settings, command)
    except ValueError as error:
        note = f"The command lacks the settings that the run was given itself, because {error}; config.json has them."
    given = [shlex.join(_given(name, value)) for name, value in (options | {"out": out}).items() if _is_given(value)]
    return " \\\n  ".join([f"graphrl {command}", *given]), note


def _own(settings: Settings, command: str) -> dict[str, Any]:
    """Options beyond the names of the run that lead to its settings.

    Raises:
      ValueError: there are none.
    """
    task = make_task(settings.task) if command == "train" else _of_demonstrations(settings)
    named = {name: getattr(settings, name) for name in (*_COMMON[1:], "stop_at")}
    ablations = _ablations(settings)
    usual = compose(task, **named, ablations=ablations, updates=settings.updates)
    groups = {group: _changed(settings, usual, group) for group in ("pretrain", "ppo")}
    try:
        found = compose(task, **named, ablations=ablations, updates=settings.updates, **groups)
    except ValueError:  # of a default that no option sets, because it changes nothing about the run
        found = None
    if found != settings:
        raise ValueError("this release has other defaults than the one that made it")
    own: dict[str, Any] = {"ablate": ablations}
    if compose(task, **named, ablations=ablations).updates != settings.updates:
        own["updates"] = settings.updates
    if command == "train" and settings.stop_at != STOP_AT:
        own["stop_at"] = settings.stop_at
    return own | {f"{group}.{name}": value for group, values in groups.items() for name, value in values.items()}


def _of_demonstrations(settings: Settings) -> Task:
    """The task of a run of `pretrain`."""
    assert settings.demos is not None
    return task_of(demonstrations.load(settings.demos))


def _ablations(settings: Settings) -> list[str]:
    """The ablations of which no option but their name can be seen in the settings."""
    config, usual = settings.pretrain_config, type(settings.pretrain_config)()
    without_edges, rule = not config.encoder.edges, config.activity
    return [
        name
        for name in settings.method.ablations
        if (without_edges and not ABLATIONS[name].edges) or ABLATIONS[name].activity == rule != usual.activity
    ]


def _changed(settings: Settings, usual: Settings, group: str) -> dict[str, Any]:
    """The fields of a group, and of its sizes, that differ from the usual ones."""
    changed: dict[str, Any] = {}
    for part in (group, f"{group}_config"):
        own, other = vars(getattr(settings, part)), vars(getattr(usual, part))
        changed |= {name: value for name, value in own.items() if name not in RESOLVED and value != other[name]}
    return changed


def _is_given(value: Any) -> bool:
    return value is not None and value != []


def _given(name: str, value: Any) -> list[str]:
    """An option as it is typed."""
    values = value if isinstance(value, list | tuple) else [value]
    return [option(name, None), *map(str, values)]
