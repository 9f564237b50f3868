"""Finished runs side by side: each policy on the same unseen episodes, with an interval over seeds.

    python -m benchmarks.match_regions env runs/env_0 runs/env_1 runs/env_2

Writes `benchmarks/results/match_regions_NAME.json` and, beside it, the learning curves and a few frames of the first
run's video as PNGs.
"""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import imageio.v3 as imageio
import numpy as np
import tyro
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from scipy.stats import t as student

from benchmarks.context import measured_on
from graphrl_jax.cli import evaluate_run
from graphrl_jax.compilation import configure
from graphrl_jax.runs import Run, read_json, write_atomically, write_json

RESULTS = Path("benchmarks/results")
KEPT = ("env_steps", "train_steps_per_s", "wall_s", "compile_s", "training_seed", "resumed", "device", "encoder")


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


def interval(values: list[float], confidence: float = 0.95) -> list[float] | None:
    """Student's interval of the mean, cut to [0, 1]; None for a single value."""
    if len(values) < 2:
        return None
    half = student.ppf((1 + confidence) / 2, len(values) - 1) * np.std(values, ddof=1) / math.sqrt(len(values))
    return [max(0.0, float(np.mean(values) - half)), min(1.0, float(np.mean(values) + half))]


def together(options: Options) -> dict[str, Any]:
    """Outcome of every run, and mean and interval over them."""
    members = []
    for path in options.runs:
        summary = read_json(path / "summary.json")
        outcome = evaluate_run(Run(path), options.episodes, options.seed)
        members.append({**outcome, **{name: summary[name] for name in KEPT if name in summary}})
    rates = [member["success_rate"] for member in members]
    return {
        "success_rate": float(np.mean(rates)),
        "success_interval_95": interval(rates),
        "mean_score": float(np.mean([member["mean_score"] for member in members])),
        "runs": members,
    }


def learning_curves(runs: tuple[Path, ...], path: Path) -> None:
    """Success of finished training episodes (varied starts included) over environment steps, a line per run."""
    figure = Figure(figsize=(6, 3.6), dpi=120)
    axes = figure.subplots()
    for run in runs:
        records = Run(run).records("ppo")
        steps = [record["env_steps"] / 1e6 for record in records]
        axes.plot(steps, [record["success"] for record in records], label=run.name)
    axes.set(xlabel="environment steps (millions)", ylabel="success, training episodes", ylim=(-0.02, 1.02))
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False)
    figure.tight_layout()
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
    results = together(options)
    write_json(RESULTS / f"match_regions_{options.name}.json", {**results, **where})
    learning_curves(options.runs, RESULTS / f"match_regions_{options.name}.png")
    film_strip(options.runs[0], RESULTS / f"match_regions_{options.name}_rollout.png")
    print({name: results[name] for name in ("success_rate", "success_interval_95", "mean_score")})


if __name__ == "__main__":
    main()
