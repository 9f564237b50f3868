"""Table I: every method's policies on Match Regions, on the same unseen episodes. One command:

    python -m benchmarks.table1 [--preset smoke] [--methods graph xirl] [--seeds 30 31 32] [--budget-minutes 60]

Members (a method and a seed) are runs in `--out`, trained one after another, methods in turn, to share a budget.
What is there already is used again, evaluations too, an interrupted member goes on, and several such commands may run
beside each other if their methods or seeds differ; a budget of 0 trains nothing. Floats of pretraining are those that
`benchmarks.tuning` chose. Writes table1.json and the learning curves to `benchmarks/results` (smoke: to `--out`; gpu:
table1_gpu), from all finished members.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Literal

import numpy as np
import tyro
from matplotlib.figure import Figure

from benchmarks import members
from benchmarks.checks import refuse_unknown
from benchmarks.context import RESULTS, measured_on
from benchmarks.exploits import unseen_trajectories
from benchmarks.figures import plain, save
from benchmarks.finished import judge_run, together
from benchmarks.tuning import TUNED, chosen
from graphrl_jax.demonstrations import Demonstrations
from graphrl_jax.experiment.checkpoints import load_run
from graphrl_jax.experiment.methods import METHODS
from graphrl_jax.experiment.presets import PRESETS
from graphrl_jax.experiment.run_directory import Run
from graphrl_jax.experiment.settings import compose
from graphrl_jax.registry import make_task
from graphrl_jax.runtime import configure
from graphrl_jax.storage import write_json
from graphrl_jax.task import Task

TASK = "match_regions"
KEPT = ("env_steps", "train_steps_per_s", "wall_s", "resumed", "reward", "training_seed")
EPISODES = {"smoke": 16, "cpu": 256, "gpu": 256}
ORDER = ("graph", "env", "graphirl", "graph_with_robot", "graphirl_with_robot", "xirl")
"""Methods in the order in which they are trained."""


@dataclass(frozen=True)
class Options:
    """Trains what is missing and puts Table I together.

    Attributes:
      preset: sizes of a run; smoke tries everything on little.
      methods: rewards, in the order in which they are trained.
      seeds: of each method.
      updates: policy updates per member; the preset's number if left out.
      budget_minutes: no member is begun after so long; all if left out.
      out: folder of the members.
      evaluation_seed: decides the episodes, the same for every member, and the audit's scenes.
    """

    preset: Literal["smoke", "cpu", "gpu"] = "cpu"
    methods: tuple[str, ...] = ORDER
    seeds: tuple[int, ...] = (30, 31, 32, 33, 34)
    updates: int | None = None
    budget_minutes: float | None = None
    out: Path = Path("runs/table1")
    evaluation_seed: int = 7

    def __post_init__(self) -> None:
        refuse_unknown("--methods", self.methods, ORDER)


def train_missing(task: Task, options: Options) -> None:
    """Trains members, or what is left of them, as long as the budget lasts."""
    wanted = {
        options.out / f"{method}_{seed}": compose(
            task, method, options.preset, seed, updates=options.updates, pretrain=chosen(method)
        )
        for seed in options.seeds
        for method in options.methods
    }
    members.train_missing(wanted, "table1", options.budget_minutes)


def kept_judgement(path: Path, unseen: Callable[[], Demonstrations], options: Options) -> dict[str, Any]:
    """`judged`, once for a policy and an evaluation seed; the folder keeps it."""
    about = {"seed": options.evaluation_seed}
    return members.judged_once(path, "table1", about, lambda: judged(path, unseen(), options), "table1")


def judged(path: Path, unseen: Demonstrations, options: Options) -> dict[str, Any]:
    """A finished member's policy on the unseen episodes, its learning curve, and the audit of a learned reward."""
    run, trained = Run(path), load_run(path)
    member = judge_run(run, trained, KEPT, EPISODES[options.preset], options.evaluation_seed, unseen)
    member["curve"] = members.curve(run)
    if trained.settings.method.encoder is not None:
        member["tuned"] = {name: float(getattr(trained.settings.pretrain, name)) for name in TUNED}
    return member


def curves_figure(methods: dict[str, dict[str, Any]], path: Path) -> None:
    """Fig. 2: success of training episodes (varied starts included) over steps and over seconds, means and extremes."""
    figure = Figure(figsize=(10, 3.8), dpi=120, layout="constrained")
    panels = zip(
        figure.subplots(1, 2, sharey=True),
        (("env_steps", 1e6, "environment steps (millions)"), ("seconds", 60, "minutes of PPO")),
        strict=True,
    )
    for axes, (name, unit, label) in panels:
        for method, result in methods.items():
            found = [member["curve"] for member in result["runs"]]
            shortest = min(len(one[name]) for one in found)
            x, y = (np.array([one[key][:shortest] for one in found]) for key in (name, "success"))
            (line,) = axes.plot(x.mean(0) / unit, y.mean(0), label=f"{method} ({len(found)})")
            axes.fill_between(x.mean(0) / unit, y.min(0), y.max(0), color=line.get_color(), alpha=0.15, linewidth=0)
        axes.set(xlabel=label, ylim=(-0.02, 1.02))
        plain(axes)
    figure.axes[0].set_ylabel("success, training episodes")
    figure.axes[0].legend(frameon=False, fontsize=8)
    save(figure, path)


def image_size(options: Options) -> int | None:
    """Size of the images that members look at; None where none of them needs images."""
    found = any(METHODS[method].needs == "images" for method in members.finished_members(options.out, ORDER))
    return PRESETS[options.preset].pretrain_config["images"].encoder.image_size if found else None


def main() -> None:
    """Trains, evaluates, prints and writes."""
    options = tyro.cli(Options, description=__doc__)
    configure()
    where = measured_on("table1")
    task = make_task(TASK)
    train_missing(task, options)
    unseen = cache(lambda: unseen_trajectories(task, options.evaluation_seed, image_size(options)))
    methods: dict[str, dict[str, Any]] = {}
    for method, paths in members.finished_members(options.out, ORDER).items():
        methods[method] = together([kept_judgement(path, unseen, options) for path in paths])
        print(method, {name: methods[method][name] for name in ("success_rate", "success_interval_95")})
    if not methods:
        raise SystemExit(f"--out {options.out} holds no finished member, and --budget-minutes left none to train")
    results = options.out if options.preset == "smoke" else RESULTS
    name = "table1_gpu" if options.preset == "gpu" else "table1"
    report = {"methods": methods, "episodes": EPISODES[options.preset], "seed": options.evaluation_seed, **where}
    write_json(results / f"{name}.json", report)
    curves_figure(methods, results / f"{name}.png")


if __name__ == "__main__":
    main()
