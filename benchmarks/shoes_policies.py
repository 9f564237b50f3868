"""Policies on Shoes in Box: every reward's policies on the same unseen layouts. One command:

    python -m benchmarks.shoes_policies [--methods graph env] [--seeds 0 1] [--budget-minutes 60] [--engines mujoco mjx]

Members (a reward and a seed) are runs in `--runs`, trained one after another by the device's default engine, one seed
of every reward in turn. What is there already is used again, evaluations too, and an interrupted member goes on; a
budget of 0 trains nothing. All start at the layout's own starts, the lid shut and both shoes on the table, and are
judged by their last frame: lid open, at least one shoe in the box and let go, both (which is success).

Of training the table says only how long it took: its episodes start along the expert's successes, so how soon they are
solved says nothing about the layout's own starts. The figure shows their success and score, a line per run.

Writes shoes_in_box_policies.json and its figure to `benchmarks/results` (smoke: to `--runs`; gpu:
shoes_in_box_policies_gpu), from all finished members and those that an earlier result file holds; `missing` names
those that the whole table still lacks. Beside them lie the video of the first `graph` member and a few frames of it.
"""

from collections.abc import Callable, Mapping
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
from benchmarks.figures import draw_curves, film
from benchmarks.finished import together
from graphrl_jax.demonstrations import Demonstrations
from graphrl_jax.experiment.checkpoints import load_run
from graphrl_jax.experiment.evaluation import unseen_episodes
from graphrl_jax.experiment.run_directory import Run
from graphrl_jax.experiment.settings import compose
from graphrl_jax.registry import ENGINES, make_task
from graphrl_jax.reward.landscape import trajectory_scores
from graphrl_jax.runtime import configure
from graphrl_jax.storage import read_json, write_json
from graphrl_jax.task import Task
from tasks.engine import default_engine

TASK = "shoes_in_box"
SEEDS = {
    "graph": (0, 1, 2),
    "env": (0, 1, 2),
    "graph_with_robot": (0,),
    "graphirl": (0,),
    "graphirl_with_robot": (0,),
}
"""Seeds of the whole table, by reward."""
EPISODES = {"smoke": 4, "cpu": 256, "gpu": 256}
KEPT = ("training_seed", "env_steps", "train_steps_per_s", "wall_s", "resumed", "device")
CURVES = {"success": "success, training episodes", "score": "score, training episodes"}
FRAMES = (0, 34, 72, 94, 120, 150)
"""Frames of an episode that are shown."""


@dataclass(frozen=True)
class Options:
    """Trains what is missing and puts the table together.

    Attributes:
      preset: sizes of a run; smoke tries everything on little.
      methods: rewards, in the order in which they are trained.
      seeds: of each reward; those of the whole table if left out.
      updates: policy updates per member; the task's number if left out.
      budget_minutes: no member is begun after so long; all if left out.
      runs: folder of the members; runs/shoes_policies_PRESET if left out.
      engines: physics engines of the evaluation.
      evaluation_seed: decides the layouts, the same for every member.
    """

    preset: Literal["smoke", "cpu", "gpu"] = "cpu"
    methods: tuple[str, ...] = tuple(SEEDS)
    seeds: tuple[int, ...] | None = None
    updates: int | None = None
    budget_minutes: float | None = None
    runs: Path | None = None
    engines: tuple[str, ...] = ("mujoco",)
    evaluation_seed: int = 7

    def __post_init__(self) -> None:
        refuse_unknown("--methods", self.methods, SEEDS)
        refuse_unknown("--engines", self.engines, ENGINES)
        if any(seed == self.evaluation_seed for _, seed in planned(self)):
            raise ValueError(f"--evaluation-seed {self.evaluation_seed} is a training's; allowed: another seed")

    @property
    def folder(self) -> Path:
        """Folder of the members."""
        return self.runs or Path("runs") / f"shoes_policies_{self.preset}"


def planned(options: Options) -> list[tuple[str, int]]:
    """The members that are asked for, as method and seed, one seed of every method in turn."""
    return members.in_turn({method: options.seeds or SEEDS[method] for method in options.methods})


def missing_members(options: Options, methods: Mapping[str, Any]) -> list[str]:
    """Members of the whole table, and others that are asked for, that `methods` lacks."""
    whole = [(method, seed) for method, seeds in SEEDS.items() for seed in seeds]
    names = dict.fromkeys(f"{method}_{seed}" for method, seed in [*whole, *planned(options)])
    there = {f"{method}_{run['training_seed']}" for method, row in methods.items() for run in row["runs"]}
    return [name for name in names if name not in there]


def train_missing(options: Options) -> None:
    """Trains members, or what is left of them, as long as the budget lasts."""
    task, engine = make_task(TASK), default_engine()
    wanted = {
        options.folder / f"{method}_{seed}": compose(
            task, method, options.preset, seed, updates=options.updates, engine=engine
        )
        for method, seed in planned(options)
    }
    members.train_missing(wanted, "shoes_policies", options.budget_minutes)


def evaluation(path: Path, task: Task, options: Options) -> dict[str, Any]:
    """A finished member's policy on unseen layouts: shares of the episodes that end in success, and with each event."""
    trained = load_run(path)._replace(task=task)
    outcomes = unseen_episodes(trained, EPISODES[options.preset], options.evaluation_seed)
    found = {name: np.asarray(values) for name, values in outcomes.items()}
    lid, shoes = found["events"][:, 0], found["events"][:, 1:]
    return {
        "training_seed": trained.settings.seed,
        "success_rate": float(found["success"].mean()),
        "mean_score": float(found["score"].mean()),
        "lid_open": float(lid.mean()),
        "one_shoe": float(shoes.any(axis=1).mean()),
    }


def audit(path: Path, unseen: Callable[[], Demonstrations]) -> dict[str, float]:
    """Shares of pairs of a success and a failure that a member's reward puts in order, see `landscape.scores`."""
    task, settings, model, _ = load_run(path)
    return trajectory_scores(model, unseen(), settings.step_discount, task.episode_length)["successes_above"]


def member(path: Path, unseen: Callable[[], Demonstrations]) -> dict[str, Any]:
    """How a finished member was trained, and the audit of a learned reward on trajectories that no training saw."""
    run, summary = Run(path), read_json(path / "summary.json")
    settings = run.settings()
    return {
        **{name: summary[name] for name in KEPT if name in summary},
        "engine": settings.engine,
        "pretrain_s": summary.get("encoder", {}).get("pretrain_s", 0.0),
        "successes_above": audit(path, unseen) if settings.method.encoder else None,
        "curve": members.curve(run, CURVES),
    }


def method_row(
    paths: list[Path], tasks: Mapping[str, Task], unseen: Callable[[], Demonstrations], options: Options
) -> dict[str, Any]:
    """The finished members of a method: how each was trained, and its policy's episodes by engine."""
    about = {"seed": options.evaluation_seed, "episodes": EPISODES[options.preset]}
    engines = {}
    for engine, task in tasks.items():
        judges = {path: partial(evaluation, path, task, options) for path in paths}
        kept = [
            members.judged_once(path, f"evaluation_{engine}", about, judge, "shoes_policies")
            for path, judge in judges.items()
        ]
        engines[engine] = together(kept)
    return {"engines": engines, "runs": [member(path, unseen) for path in paths]}


def with_earlier(methods: dict[str, Any], path: Path, options: Options) -> dict[str, Any]:
    """The rows of all methods, and members of an earlier result file whose folders are no longer there.

    Args:
      methods: rows of the members in the folder.
      path: the result file; its members count if they were judged on the same episodes.
      options: tells which these are.
    """
    if not path.exists():
        return methods
    earlier = read_json(path)
    same = {"episodes": EPISODES[options.preset], "evaluation_seed": options.evaluation_seed}
    if any(earlier[name] != value for name, value in same.items()):
        return methods
    joined = {}
    for name in [method for method in SEEDS if method in {**methods, **earlier["methods"]}]:
        rows = [row for row in (methods.get(name), earlier["methods"].get(name)) if row]
        trained = _trained_at(methods.get(name))
        engines = {}
        for engine in ENGINES:
            judged = [row["engines"].get(engine, {"runs": []})["runs"] for row in rows]
            kept = [[run for run in runs if _is_of(run, trained)] for runs in judged]
            if any(kept):
                engines[engine] = together(members.one_per_seed(kept))
        joined[name] = {"engines": engines, "runs": members.one_per_seed(row["runs"] for row in rows)}
    return joined


def _trained_at(row: Mapping[str, Any] | None) -> dict[int, str | None]:
    """The commit that each of a row's members was trained at, by seed."""
    engines = {} if row is None else row["engines"]
    return {run["training_seed"]: run.get("trained_at") for one in engines.values() for run in one["runs"]}


def _is_of(run: Mapping[str, Any], trained: Mapping[int, str | None]) -> bool:
    """Whether an evaluation is of the present member of its seed, or its seed has none."""
    seed = run["training_seed"]
    return seed not in trained or trained[seed] == run.get("trained_at")


def curves_of(methods: Mapping[str, Any]) -> dict[str, list[dict[str, float]]]:
    """The learning curves of all members as log lines."""
    return {
        f"{method}_{run['training_seed']}": [
            dict(zip(run["curve"], values, strict=True)) for values in zip(*run["curve"].values(), strict=True)
        ]
        for method, row in methods.items()
        for run in row["runs"]
    }


def write_report(options: Options) -> None:
    """Trains, evaluates, prints and writes."""
    where = measured_on("shoes_policies")
    tasks = {engine: make_task(TASK, engine) for engine in options.engines}
    train_missing(options)
    found = members.finished_members(options.folder, SEEDS)
    if not found:
        raise SystemExit(f"--runs {options.folder} holds no finished member, and --budget-minutes left none to train")
    unseen = cache(lambda: unseen_trajectories(make_task(TASK), options.evaluation_seed))
    methods = {}
    for method, paths in found.items():
        methods[method] = method_row(paths, tasks, unseen, options)
        print(method, {engine: one["success_rate"] for engine, one in methods[method]["engines"].items()}, flush=True)
    results = options.folder if options.preset == "smoke" else RESULTS
    name = "shoes_in_box_policies_gpu" if options.preset == "gpu" else "shoes_in_box_policies"
    methods = with_earlier(methods, results / f"{name}.json", options)
    report = {
        "methods": methods,
        "missing": missing_members(options, methods),
        "episodes": EPISODES[options.preset],
        "evaluation_seed": options.evaluation_seed,
        **where,
    }
    write_json(results / f"{name}.json", report)
    draw_curves(curves_of(methods), CURVES, results / f"{name}.png")
    if "graph" in found:
        film(found["graph"][0], FRAMES, results / f"{name}_rollout")
    print(f"missing: {', '.join(report['missing']) or 'nothing'}; written: {results / name}.json")


def main() -> None:
    """Reads the command line."""
    options = tyro.cli(Options, description=__doc__)
    configure()
    write_report(options)


if __name__ == "__main__":
    main()
