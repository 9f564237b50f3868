"""The learned reward on Shoes in Box: profile, discrimination of successes from failures, subtasks. One command:

    python -m benchmarks.shoes_in_box [--preset smoke]

It makes demonstrations, trains an encoder per reward and seed, and judges all of them by the same successes and
failures of a seed of their own, which no encoder saw. What is in `--out` already is used again, so an interrupted
command goes on, at the commit it began with only. Writes shoes_in_box.json and figures to `benchmarks/results`
(smoke: to `--out`).
"""

import shutil
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

import jax
import numpy as np
import tyro

from benchmarks.context import RESULTS, measured_on
from benchmarks.shoes_in_box_figures import profile_figure, subtasks_figure
from benchmarks.tuning import chosen
from graphrl_jax import demonstrations as demonstration_files
from graphrl_jax.demonstrations import Demonstrations
from graphrl_jax.experiment.keys import RunStage, stage_key
from graphrl_jax.experiment.run_directory import Run, RunError
from graphrl_jax.experiment.settings import Settings, compose
from graphrl_jax.experiment.train_encoder import EncoderJob, train_encoders
from graphrl_jax.pretrain.config import PretrainConfig
from graphrl_jax.progress import Progress
from graphrl_jax.registry import make_task
from graphrl_jax.reward.card import MODEL
from graphrl_jax.reward.config import SUBTASK_METHODS
from graphrl_jax.reward.discrimination import discrimination
from graphrl_jax.reward.model import RewardModel, demonstration_rewards, load_parameters
from graphrl_jax.reward.subtasks import demonstration_subtasks
from graphrl_jax.runtime import configure
from graphrl_jax.storage import read_json, write_json
from tasks.shoes_in_box import expert
from tasks.shoes_in_box.state import success
from tasks.shoes_in_box.task import ShoesInBox

TRAINING_SEED, VALIDATION_SEED, LAYOUT_SEED = 0, 1007, 1008
REWARDS: dict[str, tuple[str, dict[str, float]]] = {
    "graph": ("graph", {}),
    "graph_with_robot": ("graph_with_robot", {}),
    "graph_robot_heard": ("graph", {"robot_messages": 1.0}),
}
"""Methods, and floats of pretraining by which each reward differs: ours w/o and w/ robot, and the robot left out of
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


_KINDS = len(expert.FAILURES)
PRESETS = {
    "smoke": Sizes(8, 8, _KINDS, 8, 40, 1),
    "default": Sizes(64, 32, 4 * _KINDS, 64, PretrainConfig().steps, 5),
}


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


def demonstrations(task: ShoesInBox, out: Path, preset: str, image_size: int | None = None) -> list[Demonstrations]:
    """What rewards learn from and what they are judged on, made once; with images if wanted."""
    sizes, end = PRESETS[preset], "" if image_size is None else f"_{image_size}"
    wanted = {
        f"demonstrations{end}.npz": (TRAINING_SEED, sizes.demonstrations, 0),
        f"validation{end}.npz": (VALIDATION_SEED, sizes.successes, sizes.failures),
    }
    for name, (seed, successes, failures) in wanted.items():
        if not (out / name).exists():
            key = stage_key(seed, RunStage.DEMONSTRATIONS)
            task.demonstrate(key, successes, failures, image_size).save(out / name)
    return [demonstration_files.load(out / name) for name in wanted]


def trained(task: ShoesInBox, demos: Demonstrations, name: str, settings: Settings, out: Path) -> RewardModel:
    """The reward of one encoder, trained once; of a method's settings, or those of a part of one."""
    path, config = out / f"{name}_{settings.seed}", settings.pretrain_config
    if not (path / MODEL).exists():
        shutil.rmtree(path, ignore_errors=True)  # left by an interrupted training
        run = Run.create(path, "benchmark", {"task": task.name, "reward": name, "seed": settings.seed})
        with Progress() as progress:
            train_encoders([EncoderJob(run, demos, settings.pretrain, settings.seed)], config, progress)
    return load_parameters(path, config.encoder, config.activity, task.objects)


def true_progress(demos: Demonstrations) -> np.ndarray:
    """Minus the share of subtasks left at every frame, (B, T): what a perfect step-like reward would say."""
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


def discriminate_cuts(rewards_of: Callable[[Demonstrations], Any], demos: Demonstrations) -> dict[str, Any]:
    """Discrimination on demonstrations as they are, and on the same episodes followed to the task's time limit."""
    whole = replace(demos, lengths=np.full(len(demos), demos.num_frames, np.int32))
    cuts = {"demonstrations": demos, "whole_episodes": whole}
    return {cut: discriminate(np.asarray(rewards_of(some)), some) for cut, some in cuts.items()}


def judge(model: RewardModel, demos: Demonstrations) -> dict[str, Any]:
    """Discrimination on both cuts; subtasks of every kind of episode, by every method."""
    kinds = {str(kind): demos.select(demos.kinds == kind) for kind in np.unique(np.asarray(demos.kinds))}
    return {
        **discriminate_cuts(partial(demonstration_rewards, model), demos),
        "stages": {
            method: {kind: demonstration_subtasks(model, some, method)["judged"] for kind, some in kinds.items()}
            for method in SUBTASK_METHODS
        },
    }


def try_expert(task: ShoesInBox, layouts: int) -> tuple[Any, np.ndarray, np.ndarray]:
    """One attempt at each of so many unseen layouts: states (B, T, ...), frames until done (B,), success (B,)."""
    key = stage_key(LAYOUT_SEED, RunStage.DEMONSTRATIONS)
    states, busy = jax.tree.map(np.asarray, expert.rollouts(task, key, np.zeros(layouts, np.int32)))
    last = jax.tree.map(lambda leaf: leaf[:, -1], states)
    return states, busy, np.asarray(jax.vmap(success)(last))


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
    demos, unseen = demonstrations(task, out, options.preset)
    states, busy, solved = try_expert(task, sizes.layouts)
    rows = []
    for name, (method, floats) in REWARDS.items():
        for seed in range(sizes.seeds):
            pretrain = {"steps": sizes.steps, **chosen("table2", method), **floats}
            settings = compose(task, method, seed=seed, pretrain=pretrain)
            model = trained(task, demos, name, settings, out)
            rows.append({"reward": name, "seed": seed, "exponent": float(model.exponent), **judge(model, unseen)})
            print(name, seed, {cut: rows[-1][cut]["rho"] for cut in ("demonstrations", "whole_episodes")})
            if (name, seed) == ("graph", 0):
                profile_figure(task, model, unseen, states, busy, solved, results / "shoes_in_box_profile.png")
                subtasks_figure(model, unseen, results / "shoes_in_box_stages.png")
    report = {
        "expert": {"layouts": len(solved), "solved": int(solved.sum()), "seed": LAYOUT_SEED},
        "true_progress": discriminate_cuts(true_progress, unseen),
        "rewards": rows,
        "seeds": {"demonstrations": TRAINING_SEED, "validation": VALIDATION_SEED},
        "sizes": vars(sizes),
        **where,
    }
    write_json(results / "shoes_in_box.json", report)
    print(f"expert: {solved.sum()} of {len(solved)}; written: {results / 'shoes_in_box.json'}")


if __name__ == "__main__":
    main()
