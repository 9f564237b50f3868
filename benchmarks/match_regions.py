"""Finished runs side by side: each policy on the same unseen episodes, with an interval over seeds.

    python -m benchmarks.match_regions env runs/env_0 runs/env_1 runs/env_2

Learned rewards are audited besides, on landscapes and trajectories that no training saw. Writes
`benchmarks/results/match_regions_NAME.json` and, beside it, the learning curves, the first run's video, a few
frames of it and, for a learned reward, its exploits and landscape as PNGs.
"""

import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import imageio.v3 as imageio
import numpy as np
import tyro
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from benchmarks.context import measured_on
from benchmarks.exploits import exploit_figure, unseen_audit, unseen_trajectories
from graphrl_jax import pipeline, plots
from graphrl_jax.cli import load_run
from graphrl_jax.compilation import configure
from graphrl_jax.demonstrations import Demonstrations
from graphrl_jax.evaluators import interval
from graphrl_jax.landscape import audit
from graphrl_jax.reward import RewardModel
from graphrl_jax.runs import Run, read_json, write_atomically, write_json

RESULTS = Path("benchmarks/results")
KEPT = ("env_steps", "train_steps_per_s", "wall_s", "compile_s", "training_seed", "resumed", "device")
CURVES = {
    "success": "success, training episodes",
    "learned_reward": "learned reward, mean per step",
    "env_reward": "environmental reward, mean per step",
}


@dataclass(frozen=True)
class Options:
    """Evaluates finished runs of one method and puts them together.

    Attributes:
      name: of the result file.
      runs: folders of runs that differ in their seed alone.
      episodes: unseen episodes per run.
      seed: decides the episodes; the same ones for every run.
    """

    name: tyro.conf.Positional[str]
    runs: tyro.conf.Positional[tuple[Path, ...]]
    episodes: int = 256
    seed: int = 7


def together(options: Options, unseen: Demonstrations | None) -> dict[str, Any]:
    """Outcome of every run, its reward's audit if that was learned, and mean and interval over the runs."""
    members = []
    for path in options.runs:
        task, settings, reward, policy = load_run(Run(path))
        member = pipeline.evaluate_policy(task, settings, reward, policy, options.episodes, options.seed)
        summary = read_json(path / "summary.json")
        member |= {name: summary[name] for name in KEPT if name in summary}
        member["half_solved_at"] = half_solved_at(Run(path))
        if unseen is not None:
            audited = unseen_audit(task, reward, unseen, options.seed)
            member |= {"pretrain_s": summary["encoder"]["pretrain_s"], "audit": audited}
        members.append(member)
    rates = [member["success_rate"] for member in members]
    return {
        "success_rate": float(np.mean(rates)),
        "success_interval_95": interval(rates),
        "mean_score": float(np.mean([member["mean_score"] for member in members])),
        "runs": members,
    }


def half_solved_at(run: Run) -> int | None:
    """Environment steps after which half of the finished training episodes were first solved; None if never."""
    return next((line["env_steps"] for line in run.records("ppo") if line["success"] >= 0.5), None)


def learning_curves(runs: tuple[Path, ...], path: Path) -> None:
    """Success of finished training episodes (varied starts included) and rewards over steps, a line per run."""
    records = {run.name: Run(run).records("ppo") for run in runs}
    shown = [name for name in CURVES if all(name in lines[-1] for lines in records.values())]
    figure = Figure(figsize=(4 * len(shown), 3.4), dpi=120, layout="constrained")
    for axes, name in zip(figure.subplots(1, len(shown), squeeze=False)[0], shown, strict=True):
        for run, lines in records.items():
            axes.plot([line["env_steps"] / 1e6 for line in lines], [line[name] for line in lines], label=run)
        axes.set(xlabel="environment steps (millions)", ylabel=CURVES[name])
        axes.spines[["top", "right"]].set_visible(False)
    figure.axes[0].set_ylim(-0.02, 1.02)
    figure.axes[0].legend(frameon=False, fontsize=8)
    write_atomically(path, FigureCanvasAgg(figure).print_png)


def film_strip(run: Path, path: Path, frames: tuple[int, ...] = (4, 18, 34, 50, 110)) -> None:
    """Frames of the first episode of a run's video, the scene alone, side by side."""
    video = imageio.imread(run / "rollout.mp4")
    scenes = [video[frame, :, : video.shape[2] // 2] for frame in frames]
    write_atomically(path, lambda temporary: imageio.imwrite(temporary, np.concatenate(scenes, axis=1)))


def main() -> None:
    """Evaluates, prints and writes."""
    options = tyro.cli(Options, description=__doc__)
    configure()
    where = measured_on("match_regions")
    task, _, reward, _ = load_run(Run(options.runs[0]))
    unseen = unseen_trajectories(task, options.seed) if isinstance(reward, RewardModel) else None
    results = together(options, unseen)
    name = f"match_regions_{options.name}"
    write_json(RESULTS / f"{name}.json", {**results, **where})
    learning_curves(options.runs, RESULTS / f"{name}.png")
    film_strip(options.runs[0], RESULTS / f"{name}_rollout.png")
    video = options.runs[0] / "rollout.mp4"
    write_atomically(RESULTS / f"{name}_rollout.mp4", lambda temporary: shutil.copyfile(video, temporary))
    if unseen is not None:
        exploit_figure(reward, unseen, RESULTS / f"{name}_exploits.png")
        scenes = task.landscape(pipeline.stage_key(options.seed, pipeline.LANDSCAPE))
        plots.landscape(audit(reward, scenes), RESULTS / f"{name}_landscape.png")
    print({name: results[name] for name in ("success_rate", "success_interval_95", "mean_score")})


if __name__ == "__main__":
    main()
