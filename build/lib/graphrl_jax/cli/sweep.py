"""`graphrl sweep`: floats times seeds, side by side; see `requests.Sweep`."""

import itertools
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from graphrl_jax import runtime
from graphrl_jax.cli.options import asked_for, refuse_other, refuse_useless
from graphrl_jax.cli.requests import Sweep
from graphrl_jax.experiment import experiment, sweep
from graphrl_jax.experiment.experiment import Extent
from graphrl_jax.experiment.sweep import SweepMember
from graphrl_jax.progress import Progress
from graphrl_jax.registry import make_task
from graphrl_jax.reward.statistics import interval
from graphrl_jax.storage import write_json
from graphrl_jax.viz import plots

_AUDITED = ("pair_accuracy", "finished_above_unfinished", "maxima_inside", "within_above_beside", "bump_bonus")
_OF_THE_PROCESS = ("versions", "device", "wall_s", "compile_s", "compilation_cache", "resumed")


def run(request: Sweep) -> dict[str, Any]:
    """Carries the request out."""
    process_log = runtime.configure()
    _refuse_useless(request)
    members, encoders_only = _resumed(request) if request.resume else _started(request)
    task = make_task(members[0].settings.task, members[0].settings.engine)
    extent = Extent(policies=not encoders_only, videos=False, resumed=request.resume)
    folder = request.out if len(members) > 1 else None
    with Progress() as progress:
        summaries = experiment.run(members, task, progress, process_log, extent, folder)
    rows = [_row(member, summary) for member, summary in zip(members, summaries, strict=True)]
    report = {
        "members": rows,
        **process_log.times(),
        "versions": runtime.versions(),
        "device": runtime.device(),
    }
    write_json(request.out / "sweep.json", report)
    field = next(iter(members[0].swept), None)
    if field is not None:
        plots.sweep(rows, field, request.out / "figures" / "sweep.png")
    _print(rows)
    return {"out": str(request.out), "members": len(rows), "wall_s": round(report["wall_s"], 1)}


def _refuse_useless(request: Sweep) -> None:
    if request.resume:
        return
    if request.reward == "env":
        refuse_useless(request, ["demos", "encoders_only"], "with --reward env, which learns no reward")
    if request.encoders_only:
        refuse_useless(request, ["updates", "ppo"], "with --encoders-only, which trains no policies")


def _started(request: Sweep) -> tuple[list[SweepMember], bool]:
    """The members of a new sweep, validated before anything is written, and whether only encoders are trained."""
    if request.seeds < 1:
        raise ValueError(f"--seeds is {request.seeds}; allowed: 1 or more")
    task = make_task(request.task, request.engine)
    members = sweep.plan(
        request.out,
        task,
        _values(request),
        range(request.first_seed, request.first_seed + request.seeds),
        asked_for(request.pretrain),
        asked_for(request.ppo),
        reward=request.reward,
        preset=request.preset or runtime.default_preset(),
        demos=None if request.demos is None else str(request.demos),
        updates=request.updates,
        engine=request.engine,
    )
    experiment.refuse_impossible(task, members[0].settings, len(members))
    asked = {name: str(value) if isinstance(value, Path) else value for name, value in asdict(request).items()}
    sweep.start(request.out, members, asked)
    return members, request.encoders_only


def _values(request: Sweep) -> sweep.Values:
    """The swept values by field."""
    texts = [] if request.alphas is None else [f"pretrain.alpha={request.alphas}"]
    values = sweep.parse_values([*texts, *request.sweep], request.reward)
    for name in values:
        group, _ = name.split(".")
        if group == "ppo" and request.encoders_only:
            raise ValueError(f"--sweep {name} changes nothing with --encoders-only, which trains no policies")
    return values


def _resumed(request: Sweep) -> tuple[list[SweepMember], bool]:
    members, asked = sweep.resume(request.out)
    refuse_other(request, {name: value for name, value in asked.items() if name not in ("out", "resume")}, request.out)
    sweep.start_members(members)
    return members, asked["encoders_only"]


def _row(member: SweepMember, summary: dict[str, Any]) -> dict[str, Any]:
    """A member's row in the report."""
    kept = {name: value for name, value in summary.items() if name not in _OF_THE_PROCESS}
    return {**kept, "member": member.run.path.name, "seed": member.settings.seed, "swept": member.swept}


def _print(rows: Sequence[dict[str, Any]]) -> None:
    """Prints a table of means over seeds, with confidence intervals of success."""
    table = Table("swept", "seeds", "success", "95 % interval", *(name.replace("_", " ") for name in _AUDITED))
    for swept, same in itertools.groupby(rows, lambda row: row["swept"]):
        found = list(same)
        rates = [row["success_rate"] for row in found if "success_rate" in row]
        spread = interval(rates) if rates else None
        audits = [row["encoder"] for row in found if "encoder" in row]
        table.add_row(
            ", ".join(f"{name} {value:g}" for name, value in swept.items()) or "-",
            str(len(found)),
            f"{np.mean(rates):.1%}" if rates else "-",
            f"{spread[0]:.1%} to {spread[1]:.1%}" if spread else "-",
            *(f"{np.mean([audit[name] for audit in audits]):.3f}" if audits else "-" for name in _AUDITED),
        )
    Console(stderr=True).print(table)
