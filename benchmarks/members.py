"""Members of a table: runs that differ in method and seed, trained one after another and judged once each.

What a folder holds already is used again: an interrupted member goes on, a judgement is made once for a policy.
"""

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from benchmarks.context import measured_on
from graphrl_jax.cli import sweep, train
from graphrl_jax.cli.requests import Sweep, Train
from graphrl_jax.experiment.run_directory import Run
from graphrl_jax.experiment.settings import Settings
from graphrl_jax.storage import read_json, write_json

Row = TypeVar("Row")


def finished(path: Path) -> bool:
    """Whether a member is trained."""
    return (path / "summary.json").exists()


def within(members: Iterable[Row], budget_minutes: float | None) -> Iterator[Row]:
    """Members in order, as long as the budget lasts; all without one."""
    started = time.monotonic()
    for member in members:
        if budget_minutes is not None and (time.monotonic() - started) / 60 >= budget_minutes:
            return
        yield member


def train_missing(wanted: Mapping[Path, Settings], benchmark: str, budget_minutes: float | None) -> None:
    """Trains members, or what is left of them, in order, as long as the budget lasts.

    Args:
      wanted: settings of a new member, by its folder; one that is there already keeps its own.
      benchmark: module that asks for it.
      budget_minutes: no member is begun after so long; None for no limit.
    """
    for path, settings in within(wanted.items(), budget_minutes):
        if finished(path):
            continue
        if not path.exists():
            Run.start(path, settings)
        print(train.run(Train(out=path, resume=True)))
        write_json(path / "trained_on.json", measured_on(benchmark))


def finish_sweep(wanted: Sweep) -> None:
    """Carries a sweep out, or what is left of the one in its folder, which keeps its own settings."""
    if (wanted.out / "sweep.json").exists():
        return
    begun = (wanted.out / "config.json").exists()
    sweep.run(Sweep(out=wanted.out, resume=True) if begun else wanted)


def judged_once(
    path: Path, name: str, about: dict[str, Any], judge: Callable[[], dict[str, Any]], benchmark: str
) -> dict[str, Any]:
    """A judgement of a finished member, which its folder keeps, and the commits of training and judgement.

    Args:
      path: folder of the member.
      name: of the judgement.
      about: what it depends on besides the policy.
      judge: makes it.
      benchmark: module that asks for it.
    """
    stamp = {**about, "policy": (path / "policy.npz").stat().st_mtime_ns}
    file, trained = path / f"{name}.json", path / "trained_on.json"
    if not (file.exists() and read_json(file)["of"] == stamp):
        write_json(file, {"of": stamp, "judged": judge(), **measured_on(benchmark)})
    kept = read_json(file)
    commits = {
        "trained_at": read_json(trained)["commit"] if trained.exists() else None,
        "judged_at": kept.get("commit"),
    }
    return kept["judged"] | commits


def curve(run: Run, measures: Iterable[str] = ("success",)) -> dict[str, list[float]]:
    """Environment steps, seconds in the training's programs, and measures of training episodes."""
    lines = run.records("ppo")
    steps = [line["env_steps"] for line in lines]
    seconds = np.cumsum(np.diff(steps, prepend=0) / [line["steps_per_s"] for line in lines])
    measured = {name: [line[name] for line in lines] for name in measures}
    return {"env_steps": steps, "seconds": seconds.tolist(), **measured}


def area(curve: Mapping[str, Sequence[float]]) -> float:
    """Area under a curve of success over environment steps, as a share of the steps: the mean success of a training."""
    return float(np.average(curve["success"], weights=np.diff(curve["env_steps"], prepend=0)))


def in_turn(seeds: Mapping[Row, Sequence[int]]) -> list[tuple[Row, int]]:
    """Members as row and seed, one seed of every row in turn."""
    turns = range(max(map(len, seeds.values()), default=0))
    return [(row, some[turn]) for turn in turns for row, some in seeds.items() if turn < len(some)]


def one_per_seed(runs: Iterable[list[dict[str, Any]]]) -> list[dict[str, Any]]:
    """Lists of runs as one, in the order of their seeds; of several with the same seed, the first."""
    by_seed: dict[int, dict[str, Any]] = {}
    for some in runs:
        for run in some:
            by_seed.setdefault(run["training_seed"], run)
    return [by_seed[seed] for seed in sorted(by_seed)]


def finished_members(folder: Path, methods: Iterable[str]) -> dict[str, list[Path]]:
    """Folders METHOD_SEED of finished members by method, in order; methods without any are left out."""
    found = {method: sorted(folder.glob(f"{method}_[0-9]*/summary.json")) for method in methods}
    return {method: [path.parent for path in paths] for method, paths in found.items() if paths}
