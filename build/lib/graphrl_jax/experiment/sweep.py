"""Sweeps over floats and seeds. Every member is a run folder that can be read and evaluated alone.

Checkpoints of the training are kept per group of members, in the sweep's own folder.
"""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from graphrl_jax.experiment.experiment import Member
from graphrl_jax.experiment.methods import method_named
from graphrl_jax.experiment.run_directory import Run, RunError
from graphrl_jax.experiment.settings import as_json, compose, from_json
from graphrl_jax.rl.config import PPOHyper
from graphrl_jax.task import Task

Values = Mapping[str, Sequence[float]]
"""Swept values by field, such as `pretrain.alpha`."""


@dataclass(frozen=True)
class SweepMember(Member):
    """A run and its values of the swept fields."""

    swept: Mapping[str, float]


def sweepable(reward: str) -> tuple[str, ...]:
    """Fields of `PretrainHyper` and `PPOHyper` that affect a reward, with their group as prefix."""
    floats = [f"pretrain.{name}" for name in method_named(reward).floats]
    return (*floats, *(f"ppo.{one.name}" for one in fields(PPOHyper)))


def parse_values(texts: Sequence[str], reward: str) -> dict[str, tuple[float, ...]]:
    """Values by field from texts such as `pretrain.alpha=1,2,4`.

    Raises:
      ValueError: a field is unknown or given twice, or a value is not a finite number or given twice.
    """
    known = sweepable(reward)
    values: dict[str, tuple[float, ...]] = {}
    for text in texts:
        name, _, listed = text.partition("=")
        if name not in known:
            raise ValueError(
                f"--sweep {text!r}: no field {name!r} to sweep with reward {reward}; allowed: {', '.join(known)}"
            )
        if name in values:
            raise ValueError(f"--sweep {text!r}: {name} is given twice")
        values[name] = _numbers(listed, text)
    return values


def _numbers(listed: str, text: str) -> tuple[float, ...]:
    try:
        values = tuple(float(value) for value in listed.split(","))
    except ValueError:
        values = (math.nan,)
    if not np.isfinite(values).all():
        raise ValueError(f"--sweep {text!r}: {listed!r} is no list of numbers such as 0.1,1,10")
    if len({_short(value) for value in values}) < len(values):
        raise ValueError(f"--sweep {text!r}: a value is given twice")
    return values


def _short(value: float) -> str:
    """A value as it appears in a folder's name."""
    return f"{value:.12g}"


def plan(
    out: Path,
    task: Task,
    values: Values,
    seeds: Sequence[int],
    pretrain: Mapping[str, Any],
    ppo: Mapping[str, Any],
    **common: Any,
) -> list[SweepMember]:
    """The members of a sweep: every combination of the swept values with every seed.

    Args:
      out: folder of the sweep.
      task: task of all members.
      values: swept values by field.
      seeds: seeds of each combination.
      pretrain, ppo, common: see `settings.compose`; the same for all members.

    Raises:
      ValueError: there is no seed, a field is swept and set, or see `settings.compose`.
    """
    if not seeds:
        raise ValueError("a sweep has 0 seeds; allowed: 1 or more")
    members = []
    for combination in itertools.product(*values.values()):
        swept = dict(zip(values, combination, strict=True))
        groups = {"pretrain": dict(pretrain), "ppo": dict(ppo)}
        for name, value in swept.items():
            group, field = name.split(".")
            if field in groups[group]:
                raise ValueError(f"{name} is swept, and also set to {groups[group][field]} for all members")
            groups[group][field] = value
        for seed in seeds:
            settings = compose(task, seed=seed, **groups, **common)
            parts = [f"{name.split('.')[1]}={_short(value)}" for name, value in swept.items()]
            members.append(SweepMember(Run(out / ",".join([*parts, f"seed={seed}"])), settings, swept))
    return members


def start(out: Path, members: Sequence[SweepMember], request: Mapping[str, Any]) -> None:
    """Creates the sweep's folder; config.json holds the request and all members.

    Raises:
      RunError: the folder is not empty; it is not changed.
    """
    rows = [{"name": one.run.path.name, "swept": one.swept, "settings": as_json(one.settings)} for one in members]
    Run.create(out, "sweep", {"request": request, "members": rows})
    start_members(members)


def start_members(members: Sequence[SweepMember]) -> None:
    """Creates the folders of members that have none yet, or none with a config.json."""
    for member in members:
        if not (member.run.path / "config.json").exists():
            member.run.write_config("train", as_json(member.settings))


def resume(out: Path) -> tuple[list[SweepMember], dict[str, Any]]:
    """Members and request of a sweep that was started earlier.

    Raises:
      RunError: the folder holds no sweep, or its config.json is damaged.
    """
    config = Run(out).config("sweep")
    try:
        members = [
            SweepMember(Run(out / row["name"]), from_json(row["settings"]), row["swept"]) for row in config["members"]
        ]
        return members, config["request"]
    except (KeyError, TypeError, ValueError) as error:
        raise RunError(f"{out}/config.json is damaged: {error}") from error
