"""Finished runs: what their policies and rewards are worth on what no training saw."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from benchmarks.exploits import unseen_audit
from graphrl_jax.demonstrations import Demonstrations
from graphrl_jax.experiment.checkpoints import TrainedRun
from graphrl_jax.experiment.evaluation import evaluate_policy
from graphrl_jax.experiment.run_directory import Run
from graphrl_jax.reward.model import RewardModel
from graphrl_jax.reward.statistics import interval
from graphrl_jax.storage import read_json


def judge_run(
    run: Run,
    trained: TrainedRun,
    kept: Sequence[str],
    episodes: int,
    seed: int,
    unseen: Demonstrations | None,
) -> dict[str, Any]:
    """A run's policy on unseen episodes, how soon it learned, and the audit of a learned reward.

    Args:
      run: its folder.
      trained: what it has learned.
      kept: what its summary says that is to be repeated, as far as it is there.
      episodes: how many.
      seed: decides the episodes, and the audit's scenes.
      unseen: trajectories to judge a learned reward by; not needed where nothing is learned.
    """
    summary = read_json(run.path / "summary.json")
    found = evaluate_policy(trained, episodes, seed) | {name: summary[name] for name in kept if name in summary}
    found["half_solved_at"] = half_solved_at(run)
    if isinstance(trained.reward_params, RewardModel):
        assert unseen is not None
        audit = unseen_audit(trained.task, trained.reward_params, unseen, seed, trained.settings.step_discount)
        found |= {"pretrain_s": summary["encoder"]["pretrain_s"], "audit": audit}
    return found


def half_solved_at(run: Run) -> int | None:
    """Environment steps after which half of the finished training episodes were first solved; None if never."""
    return next((line["env_steps"] for line in run.records("ppo") if line["success"] >= 0.5), None)


def together(members: list[dict[str, Any]]) -> dict[str, Any]:
    """Mean and interval over runs that differ in their seed alone."""
    rates = [member["success_rate"] for member in members]
    return {
        "success_rate": float(np.mean(rates)),
        "success_interval_95": interval(rates),
        "mean_score": float(np.mean([member["mean_score"] for member in members])),
        "runs": members,
    }
