"""A sweep beside as many separate runs: the time of training, compiling included, and whether the numbers agree.

    python -m benchmarks.sweeps [--encoder-steps 40 300] [--policies 8]

    encoders  5 alphas x 3 seeds with the default sizes, for each number of steps
    policies  of the smoke size, on rewards of their own

What is timed is `train_encoders` and `train_policies`, once for all members and then for one after
the other, each time with nothing compiled and no cache on disk, as if every run were its machine's first. On one
machine all but the first find their programs in the cache; what is left of the saving then is what is left without
compiling. Making demonstrations and judging results take the same either way and are left out. Writes
benchmarks/results/sweeps.json.
"""

import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import jax
import numpy as np
import tyro

from benchmarks.checks import refuse_below
from benchmarks.context import measured_on
from benchmarks.throughput import random_reward
from graphrl_jax.experiment.experiment import make_demonstrations
from graphrl_jax.experiment.policy_programs import PolicyJob
from graphrl_jax.experiment.run_directory import Run
from graphrl_jax.experiment.settings import compose
from graphrl_jax.experiment.train_encoder import EncoderJob, train_encoders
from graphrl_jax.experiment.train_policy import train_policies
from graphrl_jax.progress import Progress
from graphrl_jax.registry import make_task
from graphrl_jax.runtime import ProcessLog, configure
from graphrl_jax.storage import write_json
from graphrl_jax.task import Task

TASK = "match_regions"
ALPHAS = (1.0, 2.0, 4.0, 8.0, 16.0)
SEEDS = (0, 1, 2)
MEASURES = {"pretrain": "loss", "ppo": "reward"}


class Job(Protocol):
    """What is trained has a folder with log lines."""

    @property
    def run(self) -> Run: ...


@dataclass(frozen=True)
class Options:
    """A sweep beside separate runs.

    Attributes:
      encoder_steps: numbers of optimiser steps, each measured.
      policies: members of the sweep of policies.
      out: where the numbers go.
    """

    encoder_steps: tuple[int, ...] = (40, 300)
    policies: int = 8
    out: Path = Path("benchmarks/results/sweeps.json")

    def __post_init__(self) -> None:
        refuse_below(self, policies=1)
        if self.encoder_steps:
            refuse_below(self, encoder_steps=1)


def compared(
    make_jobs: Callable[[str], Sequence[Job]], train: Callable[[Sequence[Any]], Any], log: ProcessLog, stage: str
) -> dict[str, Any]:
    """Trains all jobs at once, then one by one.

    Args:
      make_jobs: jobs with folders under a name.
      train: trains some jobs.
      log: counts the seconds spent compiling.
      stage: of the log lines that members are compared by, `pretrain` (the loss) or `ppo` (the reward).

    Returns:
      seconds of both and their ratio, those spent compiling, and the largest difference between a member's curve and
      that of the same job alone, as a share of the curves' greatest value.
    """
    seconds, compiling, curves = {}, {}, {}
    for name in ("together", "alone"):
        jobs = make_jobs(name)
        seconds[name] = compiling[name] = 0.0
        for group in [jobs] if name == "together" else [[job] for job in jobs]:
            jax.clear_caches()
            before, started = log.seconds, time.perf_counter()
            train(group)
            seconds[name] += time.perf_counter() - started
            compiling[name] += log.seconds - before
        curves[name] = np.array([[line[MEASURES[stage]] for line in job.run.records(stage)] for job in jobs])
    together, alone = curves["together"], curves["alone"]
    return {
        "members": len(together),
        "seconds": seconds,
        "of_separate_runs": seconds["together"] / seconds["alone"],
        "compiling": compiling,
        "largest_difference": float(np.max(np.abs(together - alone)) / np.max(np.abs(alone))),
    }


def encoders(task: Task, steps: int, log: ProcessLog, root: Path) -> dict[str, Any]:
    """Encoders of five alphas and three seeds."""
    settings = [
        compose(task, preset="cpu", seed=seed, pretrain={"steps": steps, "alpha": alpha})
        for alpha in ALPHAS
        for seed in SEEDS
    ]
    demos = {one.seed: make_demonstrations(task, one) for one in settings[: len(SEEDS)]}

    def make_jobs(name: str) -> list[EncoderJob]:
        return [
            EncoderJob(
                Run.start(root / name / f"{one.pretrain.alpha:g}_{one.seed}", one),
                demos[one.seed],
                one.pretrain,
                one.seed,
            )
            for one in settings
        ]

    def train(jobs: Sequence[EncoderJob]) -> None:
        with Progress() as progress:
            train_encoders(jobs, settings[0].pretrain_config, progress)

    return {"steps": steps, **compared(make_jobs, train, log, "pretrain")}


def policies(task: Task, count: int, log: ProcessLog, root: Path) -> dict[str, Any]:
    """Policies of several seeds, each on a reward of its own."""
    settings = [compose(task, preset="smoke", seed=seed) for seed in range(count)]
    rewards = [random_reward(task, jax.random.key(seed)) for seed in range(count)]

    def make_jobs(name: str) -> list[PolicyJob]:
        return [
            PolicyJob(Run.start(root / name / str(one.seed), one), one, reward)
            for one, reward in zip(settings, rewards, strict=True)
        ]

    def train(jobs: Sequence[PolicyJob]) -> None:
        with Progress() as progress:
            train_policies(jobs, task, progress, jobs[0].run.path.parent if len(jobs) > 1 else None)

    return {"updates": settings[0].updates, **compared(make_jobs, train, log, "ppo")}


def main() -> None:
    """Measures, prints and writes."""
    options = tyro.cli(Options, description=__doc__)
    log = configure()
    jax.config.update("jax_enable_compilation_cache", False)
    where = measured_on("sweeps")
    task = make_task(TASK)
    report: dict[str, Any] = {"encoders": []}
    with tempfile.TemporaryDirectory() as root:
        report["policies"] = policies(task, options.policies, log, Path(root) / "policies")
        print("policies", report["policies"], flush=True)
        for steps in options.encoder_steps:
            report["encoders"].append(encoders(task, steps, log, Path(root) / f"encoders_{steps}"))
            print("encoders", report["encoders"][-1], flush=True)
    write_json(options.out, report | where)


if __name__ == "__main__":
    main()
