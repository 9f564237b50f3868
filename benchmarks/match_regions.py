"""Finished runs side by side: each policy on the same unseen episodes, with an interval over seeds.

    python -m benchmarks.match_regions env runs/env_0 runs/env_1 runs/env_2

Learned rewards are audited besides, on landscapes and trajectories that no training saw. Writes
`benchmarks/results/match_regions_NAME.json` and, beside it, the learning curves, the first run's video, a few
frames of it and, for a learned reward, its exploits and landscape as PNGs.
"""

from dataclasses import dataclass
from pathlib import Path

import tyro

from benchmarks.context import RESULTS, measured_on
from benchmarks.exploits import exploit_figure, landscape_figure, unseen_trajectories
from benchmarks.figures import film, learning_curves
from benchmarks.finished import judge_run, together
from graphrl_jax.experiment.checkpoints import load_run
from graphrl_jax.experiment.run_directory import Run
from graphrl_jax.reward.model import RewardModel
from graphrl_jax.runtime import configure
from graphrl_jax.storage import write_json

KEPT = ("env_steps", "train_steps_per_s", "wall_s", "compile_s", "training_seed", "resumed", "device")
CURVES = {
    "success": "success, training episodes",
    "learned_reward": "learned reward, mean per step",
    "env_reward": "environmental reward, mean per step",
}
FRAMES = (4, 18, 34, 50, 110)
"""Frames of an episode that are shown."""


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


def main() -> None:
    """Evaluates, prints and writes."""
    options = tyro.cli(Options, description=__doc__)
    configure()
    where = measured_on("match_regions")
    trained = [load_run(path) for path in options.runs]
    task, settings, reward, _ = trained[0]
    learned = isinstance(reward, RewardModel)
    unseen = unseen_trajectories(task, options.seed, settings.image_size) if learned else None
    results = together(
        [
            judge_run(Run(path), one, KEPT, options.episodes, options.seed, unseen)
            for path, one in zip(options.runs, trained, strict=True)
        ]
    )
    name = f"match_regions_{options.name}"
    write_json(RESULTS / f"{name}.json", {**results, **where})
    learning_curves(options.runs, CURVES, RESULTS / f"{name}.png")
    film(options.runs[0], FRAMES, RESULTS / f"{name}_rollout")
    if unseen is not None:
        exploit_figure(reward, unseen, RESULTS / f"{name}_exploits.png")
        landscape_figure(task, reward, options.seed, RESULTS / f"{name}_landscape.png")
    print({name: results[name] for name in ("success_rate", "success_interval_95", "mean_score")})


if __name__ == "__main__":
    main()
