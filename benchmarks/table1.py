"""Table I: every method's policies on Match Regions, on the same unseen episodes. One command:

    python -m benchmarks.table1 [--preset smoke] [--methods graph xirl] [--seeds 30 31 32] [--budget-minutes 60]

Members (a method and a seed) are runs in `--out`, trained one after another, methods in turn, to share a budget.
What is there already is used again, evaluations too, an interrupted member goes on, and several such commands may run
beside each other if their methods or seeds differ; a budget of 0 trains nothing. Floats of pretraining are those that
`benchmarks.tuning` chose. Writes table1.json and the learning curves to `benchmarks/results` (smoke: to `--out`; gpu:
table1_gpu), from all finished members.
"""

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, Literal

import numpy as np
import tyro
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from benchmarks.context import measured_on
from benchmarks.exploits import unseen_audit, unseen_trajectories
from benchmarks.match_regions import half_solved_at
from benchmarks.tuning import METHODS, chosen
from graphrl_jax import pipeline, runs
from graphrl_jax.cli import Train, load_run, train
from graphrl_jax.compilation import configure
from graphrl_jax.demonstrations import Demonstrations
from graphrl_jax.evaluators import interval
from graphrl_jax.pretrain import PretrainHyper
from graphrl_jax.reward import RewardModel
from graphrl_jax.runs import Run, read_json, write_atomically, write_json
from graphrl_jax.settings import Settings
from graphrl_jax.task import Task, make_task

RESULTS = Path("benchmarks/results")
TASK = "match_regions"
KEPT = ("env_steps", "train_steps_per_s", "wall_s", "resumed")
EPISODES = {"smoke": 16, "cpu": 256, "gpu": 256}


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
    methods: tuple[str, ...] = METHODS
    seeds: tuple[int, ...] = (30, 31, 32, 33, 34)
    updates: int | None = None
    budget_minutes: float | None = None
    out: Path = Path("runs/table1")
    evaluation_seed: int = 7

    def __post_init__(self) -> None:
        for method in self.methods:
            if method not in METHODS:
                raise ValueError(f"--methods {method!r}; allowed: {', '.join(METHODS)}")


def train_member(task: Task, options: Options, method: str, seed: int, path: Path) -> None:
    """Trains one member, or what is left of it."""
    if not path.exists():
        hyper = pipeline.pretrain_hyper(task, PretrainHyper().alpha, method)
        settings = Settings(
            task=TASK,
            reward=method,  # type: ignore[arg-type]
            preset=options.preset,
            seed=seed,
            updates=options.updates,
            pretrain=replace(hyper, **chosen(method)),
        )
        Run.create(path, {"command": "train", "version": runs.VERSION, **asdict(settings)})
    train(Train(out=path, resume=True))
    write_json(path / "trained_on.json", measured_on("table1"))


def kept_judgement(path: Path, unseen: Callable[[], Demonstrations], options: Options) -> dict[str, Any]:
    """`judged`, once for a policy and an evaluation seed; the folder keeps it."""
    stamp = {"seed": options.evaluation_seed, "policy": (path / "policy.npz").stat().st_mtime_ns}
    file, trained = path / "table1.json", path / "trained_on.json"
    if not (file.exists() and read_json(file)["of"] == stamp):
        write_json(file, {"of": stamp, "judged": judged(path, unseen(), options), **measured_on("table1")})
    kept = read_json(file)
    commits = {
        "trained_at": read_json(trained)["commit"] if trained.exists() else None,
        "judged_at": kept.get("commit"),
    }
    return kept["judged"] | commits


def judged(path: Path, unseen: Demonstrations, options: Options) -> dict[str, Any]:
    """A finished member's policy on the unseen episodes, its learning curve, and the audit of a learned reward."""
    task, settings, reward, policy = load_run(Run(path))
    seed = options.evaluation_seed
    member = pipeline.evaluate_policy(task, settings, reward, policy, EPISODES[options.preset], seed)
    summary = read_json(path / "summary.json")
    member |= {name: summary[name] for name in KEPT} | {"reward": settings.reward, "training_seed": settings.seed}
    member["half_solved_at"] = half_solved_at(Run(path))
    member["curve"] = curve(Run(path))
    if isinstance(reward, RewardModel):
        audited = unseen_audit(task, reward, unseen, seed)
        member |= {"pretrain_s": summary["encoder"]["pretrain_s"], "audit": audited}
        floats = {name: float(getattr(settings.pretrain, name)) for name in ("learning_rate", "temperature")}
        member["tuned"] = floats
    return member


def curve(run: Run) -> dict[str, list[float]]:
    """Environment steps, seconds in the training's programs, and success of training episodes."""
    lines = run.records("ppo")
    steps = [line["env_steps"] for line in lines]
    seconds = np.cumsum(np.diff(steps, prepend=0) / [line["steps_per_s"] for line in lines])
    return {"env_steps": steps, "seconds": seconds.tolist(), "success": [line["success"] for line in lines]}


def together(members: list[dict[str, Any]]) -> dict[str, Any]:
    """Mean and interval over a method's members."""
    rates = [member["success_rate"] for member in members]
    return {
        "success_rate": float(np.mean(rates)),
        "success_interval_95": interval(rates),
        "mean_score": float(np.mean([member["mean_score"] for member in members])),
        "runs": members,
    }


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
        axes.spines[["top", "right"]].set_visible(False)
    figure.axes[0].set_ylabel("success, training episodes")
    figure.axes[0].legend(frameon=False, fontsize=8)
    write_atomically(path, FigureCanvasAgg(figure).print_png)


def main() -> None:
    """Trains, evaluates, prints and writes."""
    options = tyro.cli(Options, description=__doc__)
    configure()
    where = measured_on("table1")
    started = time.monotonic()
    task = make_task(TASK)
    for seed in options.seeds:
        for method in options.methods:
            path = options.out / f"{method}_{seed}"
            spent = (time.monotonic() - started) / 60
            late = options.budget_minutes is not None and spent > options.budget_minutes
            if not late and not (path / "summary.json").exists():
                train_member(task, options, method, seed, path)
    unseen = cache(lambda: unseen_trajectories(task, options.evaluation_seed, picture_size(options)))
    methods: dict[str, dict[str, Any]] = {}
    for method in METHODS:
        finished = sorted(path.parent for path in options.out.glob(f"{method}_[0-9]*/summary.json"))
        if finished:
            methods[method] = together([kept_judgement(path, unseen, options) for path in finished])
            print(method, {name: methods[method][name] for name in ("success_rate", "success_interval_95")})
    if not methods:
        raise SystemExit(f"--out {options.out} holds no finished member, and --budget-minutes left none to train")
    results = options.out if options.preset == "smoke" else RESULTS
    name = "table1_gpu" if options.preset == "gpu" else "table1"
    report = {"methods": methods, "episodes": EPISODES[options.preset], "seed": options.evaluation_seed, **where}
    write_json(results / f"{name}.json", report)
    curves_figure(methods, results / f"{name}.png")


def picture_size(options: Options) -> int | None:
    """Size of the pictures that members of XIRL look at; None without such members."""
    found = any(options.out.glob("xirl_[0-9]*/summary.json"))
    return Settings(reward="xirl", preset=options.preset).pretraining.encoder.picture_size if found else None


if __name__ == "__main__":
    main()
