"""The audit at the end of every pretraining: the learned reward away from its demonstrations."""

from functools import cache
from typing import Any

import numpy as np

from graphrl_jax.experiment.environments import image_drawer
from graphrl_jax.experiment.keys import RunStage, stage_key
from graphrl_jax.experiment.train_encoder import EncoderJob
from graphrl_jax.reward.config import SUBTASK_METHODS
from graphrl_jax.reward.discrimination import discrimination
from graphrl_jax.reward.landscape import Landscape, audit, scores
from graphrl_jax.reward.model import RewardModel, demonstration_rewards
from graphrl_jax.reward.subtasks import demonstration_subtasks
from graphrl_jax.storage import write_json
from graphrl_jax.task import Task
from graphrl_jax.viz import plots


@cache
def audit_scenes(task: Task, seed: int) -> Landscape:
    """The scenes of an audit. Cached, because drawing them takes longer than evaluating a reward on them."""
    return task.landscape(stage_key(seed, RunStage.LANDSCAPE))


def audit_reward(job: EncoderJob, task: Task, model: RewardModel, discount: float) -> dict[str, Any]:
    """Evaluates the reward on unseen scenes and held-out demonstrations, plots it, and finds subtasks.

    Args:
      job: says where to write, and what the encoder has not seen.
      task: draws the scenes.
      model: the reward.
      discount: per control step, of the trajectories' discounted sums.

    Returns:
      The metrics of the landscape; trajectory_scores; discrimination of successes from failures, if there are failures;
      subtasks, the metrics of the subtasks of held-out successes, None without true events.
    """
    report = audit(model, audit_scenes(task, job.seed), image_drawer(task, model))
    if report.grids:
        plots.landscape(report, job.run.figures / "landscape.png")
    unseen, held_out = job.unseen, job.split[1]
    rewards = np.asarray(demonstration_rewards(model, unseen))
    plots.reward_over_time(
        rewards[unseen.success],
        held_out.lengths,
        held_out.events,
        held_out.event_names,
        held_out.frame_rate,
        job.run.figures / "reward_on_demonstrations.png",
        "Learned reward on held-out demonstrations",
    )
    sums = scores(rewards, unseen, discount, horizon=task.episode_length)
    metrics = {**report.metrics(), "trajectory_scores": sums}
    if not unseen.success.all():
        metrics["discrimination"] = discrimination(rewards, unseen.lengths, unseen.success)
    method = SUBTASK_METHODS[0]
    found = demonstration_subtasks(model, held_out, method)
    write_json(job.run.path / "subtasks.json", {"method": method, **found})
    return {**metrics, "subtasks": found.get("judged")}
