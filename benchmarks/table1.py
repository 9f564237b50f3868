"""Table I: policies on every reward, on two grounds of Match Regions, the same unseen episodes each. One command:

    python -m benchmarks.table1 [--preset smoke] [--rows graph xirl_paper] [--grounds demo] [--seeds 10]
                                [--budget-minutes 60]

Members (a ground, a row of `benchmarks.rows` and a seed) are runs in `--runs`, trained one after another, one seed of
every row in turn. What is there already is used again, evaluations too, and an interrupted member goes on; several such
commands may run beside each other if their rows or seeds differ. A budget of 0 trains nothing. Floats of pretraining
are those that `benchmarks.tuning` chose.

Writes table1.json and its figure to `benchmarks/results` (smoke: to `--runs`; gpu: table1_gpu), from all finished
members and those that an earlier result file holds; `missing` names those that the whole table still lacks.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
import tyro

from benchmarks import members
from benchmarks.checks import refuse_unknown
from benchmarks.context import RESULTS, measured_on
from benchmarks.exploits import unseen_trajectories
from benchmarks.finished import judge_run
from benchmarks.rows import OURS, ROWS
from benchmarks.statistics import improvement, interquartile_mean_of
from benchmarks.table1_figure import table1_figure
from benchmarks.tuning import chosen
from graphrl_jax.demonstrations import Demonstrations
from graphrl_jax.experiment.checkpoints import load_run
from graphrl_jax.experiment.methods import METHODS
from graphrl_jax.experiment.presets import PRESETS
from graphrl_jax.experiment.run_directory import Run
from graphrl_jax.experiment.settings import compose
from graphrl_jax.registry import make_task
from graphrl_jax.runtime import configure
from graphrl_jax.storage import read_json, write_json
from graphrl_jax.task import Task
from tasks.engine import default_engine

GROUNDS = {"demo": "match_regions", "layout": "match_regions_layout"}
"""Tasks: poses shifted by up to 0.03, and everything anywhere."""
UPDATES = {"cpu": {"layout": 600}}
"""Policy updates by preset and ground, where they are not the task's: 102 members of 1500 would take days."""
TUNED = {"demo": "table1", "layout": "table1_layout"}
"""Tables of `benchmarks.tuning` by ground."""
KEPT = ("env_steps", "train_steps_per_s", "wall_s", "resumed", "reward", "training_seed", "device")
EPISODES = {"smoke": 16, "cpu": 256, "gpu": 256}
MEASURES = ("success_rate", "area")
FIRST_SEED = 10
"""Settings were chosen with other seeds."""

Runs = dict[str, dict[str, list[dict[str, Any]]]]
"""Members by ground and row."""


@dataclass(frozen=True)
class Options:
    """Trains what is missing and puts Table I together.

    Attributes:
      preset: sizes of a run; smoke tries everything on little.
      grounds: where policies are trained and judged.
      rows: rewards, in the order in which they are trained.
      seeds: of each row; those of the whole table if left out.
      updates: policy updates per member; if left out, those of the table, `UPDATES` or the task's number.
      budget_minutes: no member is begun after so long; all if left out.
      runs: folder of the members; runs/table1_PRESET if left out.
      evaluation_seed: decides the episodes, the same for every member of a ground, and the audit's scenes.
    """

    preset: Literal["smoke", "cpu", "gpu"] = "cpu"
    grounds: tuple[str, ...] = tuple(GROUNDS)
    rows: tuple[str, ...] = tuple(ROWS)
    seeds: tuple[int, ...] | None = None
    updates: int | None = None
    budget_minutes: float | None = None
    runs: Path | None = None
    evaluation_seed: int = 7

    def __post_init__(self) -> None:
        refuse_unknown("--rows", self.rows, ROWS)
        refuse_unknown("--grounds", self.grounds, GROUNDS)
        if any(seed == self.evaluation_seed for *_, seed in planned(self)):
            raise ValueError(f"--evaluation-seed {self.evaluation_seed} is a training's; allowed: another seed")

    @property
    def folder(self) -> Path:
        """Folder of the members."""
        return self.runs or Path("runs") / f"table1_{self.preset}"


def seeds_of(row: str) -> tuple[int, ...]:
    """Seeds of a row in the whole table."""
    return tuple(range(FIRST_SEED, FIRST_SEED + ROWS[row].seeds))


def planned(options: Options) -> list[tuple[str, str, int]]:
    """The members that are asked for, as ground, row and seed, one seed of every row in turn."""
    seeds = {(ground, row): options.seeds or seeds_of(row) for ground in options.grounds for row in options.rows}
    return [(*place, seed) for place, seed in members.in_turn(seeds)]


def missing_members(runs: Runs) -> list[str]:
    """Members of the whole table that are not among these, as GROUND/ROW_SEED."""
    whole = [(ground, row, seed) for ground in GROUNDS for row in ROWS for seed in seeds_of(row)]
    there = {
        (ground, row, run["training_seed"]) for ground in runs for row, some in runs[ground].items() for run in some
    }
    return [f"{ground}/{row}_{seed}" for ground, row, seed in whole if (ground, row, seed) not in there]


def train_missing(options: Options) -> None:
    """Trains members, or what is left of them, as long as the budget lasts."""
    tasks, engine = {ground: make_task(GROUNDS[ground]) for ground in options.grounds}, default_engine()
    wanted = {}
    for ground, name, seed in planned(options):
        row = ROWS[name]
        tuned = chosen(TUNED[ground], name)
        if row.learned and not tuned and options.preset != "smoke":
            asked = f"python -m benchmarks.tuning --tables {TUNED[ground]} --rows {name}"
            raise ValueError(f"row {name} is not tuned on {ground}; run first: {asked}")
        floats = {**tuned, **row.floats}
        updates = options.updates or UPDATES.get(options.preset, {}).get(ground)
        wanted[options.folder / ground / f"{name}_{seed}"] = compose(
            tasks[ground], row.method, options.preset, seed, updates=updates, engine=engine, pretrain=floats
        )
    members.train_missing(wanted, "table1", options.budget_minutes)


def judged(path: Path, unseen: Callable[[], Demonstrations], options: Options) -> dict[str, Any]:
    """A finished member's policy on the unseen episodes, its learning curve, and the audit of a learned reward."""
    run, trained = Run(path), load_run(path)
    shown = unseen() if trained.settings.method.encoder else None
    found = judge_run(run, trained, KEPT, EPISODES[options.preset], options.evaluation_seed, shown)
    curve = members.curve(run)
    return {**found, "engine": trained.settings.engine, "curve": curve, "area": members.area(curve)}


def finished_runs(options: Options) -> Runs:
    """The finished members in the folder, each judged once."""
    about = {"seed": options.evaluation_seed, "episodes": EPISODES[options.preset]}
    runs: Runs = {}
    for ground, name in GROUNDS.items():
        found = members.finished_members(options.folder / ground, ROWS)
        unseen = _unseen(make_task(name), options, found)
        for row, paths in found.items():
            judges = [partial(judged, path, unseen, options) for path in paths]
            runs.setdefault(ground, {})[row] = [
                members.judged_once(path, "table1", about, judge, "table1")
                for path, judge in zip(paths, judges, strict=True)
            ]
    return runs


def _unseen(task: Task, options: Options, rows: Iterable[str]) -> Callable[[], Demonstrations]:
    """Makes the trajectories that learned rewards are judged by when they are first needed, with images if any row
    looks at them."""
    looks = any(METHODS[ROWS[row].method].needs == "images" for row in rows)
    size = PRESETS[options.preset].pretrain_config["images"].encoder.image_size if looks else None
    return cache(lambda: unseen_trajectories(task, options.evaluation_seed, size))


def with_earlier(runs: Runs, path: Path, options: Options) -> Runs:
    """These members, and those of an earlier result file on the same episodes whose folders are no longer there."""
    if not path.exists():
        return runs
    earlier = read_json(path)
    if (earlier["episodes"], earlier["seed"]) != (EPISODES[options.preset], options.evaluation_seed):
        return runs
    kept = {ground: {row: found["runs"] for row, found in rows.items()} for ground, rows in earlier["grounds"].items()}
    joined: Runs = {}
    for ground in GROUNDS:
        for row in ROWS:
            some = [of.get(ground, {}).get(row, []) for of in (runs, kept)]
            if any(some):
                joined.setdefault(ground, {})[row] = members.one_per_seed(some)
    return joined


def summarised(runs: Runs) -> dict[str, Any]:
    """Interquartile means of every row by ground, and how our row compares with the others."""
    grounds = {
        ground: {
            row: {name: interquartile_mean_of([_values(some, name)]) for name in MEASURES} | {"runs": some}
            for row, some in rows.items()
        }
        for ground, rows in runs.items()
    }
    others = dict.fromkeys(row for rows in runs.values() for row in rows if row != OURS)
    found = {other: _compared(runs, other) for other in others}
    return {"grounds": grounds, "improvement": {other: one for other, one in found.items() if one}}


def _compared(runs: Runs, other: str) -> dict[str, Any] | None:
    """Probability that a run of ours has the larger area than one of another row, over the grounds that have both."""
    shared = [ground for ground, rows in runs.items() if OURS in rows and other in rows]
    if not shared:
        return None
    ours, theirs = ([_values(runs[ground][row], "area") for ground in shared] for row in (OURS, other))
    return {"grounds": shared, **improvement(ours, theirs)}


def _values(runs: Sequence[Mapping[str, Any]], name: str) -> list[float]:
    return [run[name] for run in runs]


def write_report(options: Options) -> None:
    """Trains, evaluates, prints and writes."""
    where = measured_on("table1")
    train_missing(options)
    smoke = options.preset == "smoke"
    path = (options.folder if smoke else RESULTS) / f"table1{'_gpu' if options.preset == 'gpu' else ''}.json"
    runs = with_earlier(finished_runs(options), path, options)
    if not runs:
        raise SystemExit(f"--runs {options.folder} holds no finished member, and --budget-minutes left none to train")
    found = summarised(runs)
    missing = missing_members(runs)
    about = {"missing": missing, "episodes": EPISODES[options.preset], "seed": options.evaluation_seed}
    write_json(path, {**found, **about, **where})
    table1_figure(runs, path.with_suffix(".png"))
    for ground, rows in found["grounds"].items():
        for row, one in rows.items():
            print(ground, row, {name: round(float(np.mean(_values(one["runs"], name))), 3) for name in MEASURES})
    print(f"missing: {len(missing)} members; written: {path}")


def main() -> None:
    """Reads the command line."""
    options = tyro.cli(Options, description=__doc__)
    configure()
    write_report(options)


if __name__ == "__main__":
    main()
