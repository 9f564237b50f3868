"""The learned reward on Shoes in Box: profile, discrimination of successes from failures, stages. One command:

    python -m benchmarks.shoes_in_box [--preset smoke]

It makes demonstrations, trains an encoder per reward and seed, and judges all of them by the same successes and
failures of a seed of their own, which no encoder saw. What is in `--out` already is used again, so an interrupted
command goes on, at the commit it began with only. Writes shoes_in_box.json and pictures to `benchmarks/results`
(smoke: to `--out`).
"""

import shutil
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import jax
import numpy as np
import tyro

from benchmarks.context import measured_on
from benchmarks.shoes_in_box_figures import profile_figure, stages_figure
from graphrl_jax import demonstrations as demonstration_files
from graphrl_jax import pipeline, training
from graphrl_jax.compilation import configure
from graphrl_jax.demonstrations import Demonstrations
from graphrl_jax.discrimination import discrimination
from graphrl_jax.pretrain import PretrainConfig, PretrainHyper
from graphrl_jax.progress import Progress
from graphrl_jax.reward import RewardModel, demonstration_rewards
from graphrl_jax.runs import Run, RunError, read_json, write_json
from graphrl_jax.task import make_task
from tasks.shoes_in_box import expert
from tasks.shoes_in_box.env import ShoesInBox

RESULTS = Path("benchmarks/results")
TRAINING_SEED, VALIDATION_SEED, LAYOUT_SEED = 0, 1007, 1008
REWARDS: dict[str, dict[str, float]] = {
    "graph": {},
    "graph_with_robot": pipeline.WITH_ROBOT,
    "graph_robot_heard": {"robot_messages": 1.0},
}
"""Floats of pretraining by which each reward differs from the task's: ours w/o and w/ robot, and the robot left out of
the pooling alone (Eq. 1 to the letter), where its messages still reach the other nodes."""


@dataclass(frozen=True)
class Sizes:
    """Training demonstrations; successes and failures that judge; layouts the expert is tried on; steps and seeds."""

    demonstrations: int
    successes: int
    failures: int
    layouts: int
    steps: int
    seeds: int


PRESETS = {"smoke": Sizes(8, 8, 6, 8, 40, 1), "default": Sizes(64, 32, 36, 64, PretrainConfig().steps, 5)}


@dataclass(frozen=True)
class Options:
    """Trains and judges rewards on Shoes in Box.

    Attributes:
      preset: smoke tries everything on little.
      out: where demonstrations and encoders are kept; runs/shoes_in_box_PRESET if left out.
    """

    preset: Literal["smoke", "default"] = "default"
    out: Path | None = None


def claim(out: Path, began: dict[str, Any]) -> None:
    """Begins a folder of this benchmark, or goes on in one that was begun alike.

    Raises:
      RunError: the folder holds something else, or was begun at another commit or with other sizes.
    """
    kept = read_json(out / "config.json") if (out / "config.json").exists() else None
    if kept is None and out.exists() and any(out.iterdir()):
        raise RunError(f"{out} holds something else; choose another folder with --out")
    if kept not in (None, began):
        raise RunError(f"{out} was begun with {kept}, but this is {began}; choose another folder with --out")
    write_json(out / "config.json", began)


def kept_demonstrations(
    task: ShoesInBox, path: Path, seed: int, successes: int, failures: int, picture_size: int | None = None
) -> Demonstrations:
    """Demonstrations of a seed, made once."""
    if not path.exists():
        key = pipeline.stage_key(seed, pipeline.DEMONSTRATIONS)
        task.demonstrate(key, successes, failures, picture_size).save(path)
    return demonstration_files.load(path)


def trained(
    task: ShoesInBox,
    demos: Demonstrations,
    name: str,
    seed: int,
    config: PretrainConfig,
    hyper: PretrainHyper,
    out: Path,
) -> RewardModel:
    """The reward of one encoder, trained once."""
    path = out / f"{name}_{seed}"
    if not (path / "encoder.npz").exists():
        shutil.rmtree(path, ignore_errors=True)  # left by an interrupted training
        run = Run.create(path, {"command": "benchmark", "task": task.name, "reward": name, "seed": seed})
        with Progress() as progress:
            training.train_encoder(run, demos, config, hyper, seed, progress)
    return pipeline.load_reward(Run(path), config.encoder, task, config.persistent)


def whole_episodes(demos: Demonstrations) -> Demonstrations:
    """The same episodes, not cut where a demonstration ends but followed to the task's time limit."""
    return replace(demos, lengths=np.full(len(demos), demos.num_frames, np.int32))


def true_progress(demos: Demonstrations) -> np.ndarray:
    """Minus the share of stages left at every frame, (B, T): what a perfect step-like reward would say."""
    assert demos.events is not None
    frames = np.arange(demos.num_frames)[:, None]
    return -1.0 + ((demos.events[:, None] >= 0) & (frames >= demos.events[:, None])).mean(-1)


def discriminate(rewards: np.ndarray, demos: Demonstrations) -> dict[str, Any]:
    """Discrimination, over all failures and for each kind of them."""
    assert demos.kinds is not None
    kinds = {}
    for kind in np.unique(demos.kinds[~demos.success]):
        some = demos.success | (demos.kinds == kind)
        found = discrimination(rewards[some], demos.lengths[some], demos.success[some])
        kinds[str(kind)] = {name: found[name] for name in ("rho", "auroc", "auroc_per_step", "order_failure")}
    return {**discrimination(rewards, demos.lengths, demos.success), "kinds": kinds}


def judge(model: RewardModel, demos: Demonstrations) -> dict[str, Any]:
    """Discrimination on demonstrations and on whole episodes; stages of every kind of episode, by every method."""
    whole = whole_episodes(demos)
    kinds = {str(kind): demos.select(demos.kinds == kind) for kind in np.unique(np.asarray(demos.kinds))}
    return {
        "demonstrations": discriminate(np.asarray(demonstration_rewards(model, demos)), demos),
        "whole_episodes": discriminate(np.asarray(demonstration_rewards(model, whole)), whole),
        "stages": {
            method: {kind: pipeline.demonstration_stages(model, some, method)["judged"] for kind, some in kinds.items()}
            for method in pipeline.STAGE_METHODS
        },
    }


def try_expert(task: ShoesInBox, layouts: int) -> tuple[Any, np.ndarray, np.ndarray]:
    """One attempt at each of so many unseen layouts: states (B, T, ...), frames until done (B,), success (B,)."""
    key = pipeline.stage_key(LAYOUT_SEED, pipeline.DEMONSTRATIONS)
    states, busy = jax.tree.map(np.asarray, expert.rollouts(task, key, np.zeros(layouts, np.int32)))
    last = jax.tree.map(lambda leaf: leaf[:, -1], states)
    return states, busy, np.asarray(jax.vmap(expert.environment.success)(last))


def main() -> None:
    """Makes, trains, judges, draws, prints and writes."""
    options = tyro.cli(Options, description=__doc__)
    configure()
    where = measured_on("shoes_in_box")
    sizes = PRESETS[options.preset]
    out = options.out or Path("runs") / f"shoes_in_box_{options.preset}"
    claim(out, {"command": "benchmarks.shoes_in_box", "commit": where["commit"], "sizes": vars(sizes)})
    results = RESULTS if options.preset == "default" else out
    task = make_task("shoes_in_box")
    assert isinstance(task, ShoesInBox)
    demos = kept_demonstrations(task, out / "demonstrations.npz", TRAINING_SEED, sizes.demonstrations, 0)
    unseen = kept_demonstrations(task, out / "validation.npz", VALIDATION_SEED, sizes.successes, sizes.failures)
    states, busy, solved = try_expert(task, sizes.layouts)
    rows = []
    for name in REWARDS:
        for seed in range(sizes.seeds):
            hyper = replace(task.pretraining, **REWARDS[name])
            model = trained(task, demos, name, seed, PretrainConfig(steps=sizes.steps), hyper, out)
            rows.append({"reward": name, "seed": seed, "exponent": float(model.exponent), **judge(model, unseen)})
            print(name, seed, {cut: rows[-1][cut]["rho"] for cut in ("demonstrations", "whole_episodes")})
            if (name, seed) == ("graph", 0):
                profile_figure(task, model, unseen, states, busy, solved, results / "shoes_in_box_profile.png")
                stages_figure(model, unseen, results / "shoes_in_box_stages.png")
    progress = true_progress(unseen)
    report = {
        "expert": {"layouts": len(solved), "solved": int(solved.sum()), "seed": LAYOUT_SEED},
        "true_progress": {
            "demonstrations": discriminate(progress, unseen),
            "whole_episodes": discriminate(progress, whole_episodes(unseen)),
        },
        "rewards": rows,
        "seeds": {"demonstrations": TRAINING_SEED, "validation": VALIDATION_SEED},
        "sizes": vars(sizes),
        **where,
    }
    write_json(results / "shoes_in_box.json", report)
    print(f"expert: {solved.sum()} of {len(solved)}; written: {results / 'shoes_in_box.json'}")


if __name__ == "__main__":
    main()
