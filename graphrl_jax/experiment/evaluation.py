"""Evaluation of a policy on unseen episodes: metrics, video and plot."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from graphrl_jax.experiment.checkpoints import TrainedRun
from graphrl_jax.experiment.environments import environment_of
from graphrl_jax.experiment.keys import RunStage, stage_key
from graphrl_jax.experiment.run_directory import Run
from graphrl_jax.rl import rollout
from graphrl_jax.rl.config import PPOConfig
from graphrl_jax.viz import plots
from graphrl_jax.viz.video import write_video

SEED_OFFSET = 1000
"""Difference between the seed of a run and the seed of its final evaluation."""
CHECK_OFFSET = 2000
"""The same of evaluations during the training, which may end it."""


def evaluate_policy(trained: TrainedRun, episodes: int, seed: int) -> dict[str, Any]:
    """Evaluates the deterministic policy on unseen episodes.

    Args:
      trained: the policy with its task, settings and reward.
      episodes: number of episodes.
      seed: selects the episodes.

    Returns:
      success_rate, mean_score and mean_return (of the reward that the policy was trained on), episodes and seed.
    """
    return averages(unseen_episodes(trained, episodes, seed), seed)


def averages(outcomes: dict[str, jax.Array], seed: int) -> dict[str, Any]:
    """Means over the outcomes of episodes; see `evaluate_policy`."""
    return {
        "success_rate": float(jnp.mean(outcomes["success"])),
        "mean_score": float(jnp.mean(outcomes["score"])),
        "episodes": len(outcomes["success"]),
        "mean_return": float(jnp.mean(outcomes["episode_return"])),
        "seed": seed,
    }


def unseen_episodes(trained: TrainedRun, episodes: int, seed: int) -> dict[str, jax.Array]:
    """Outcomes of the episodes that `evaluate_policy` averages, each (episodes,); see `rollout.episode_outcomes`.

    `events` (episodes, E) bool says which of the task's events hold at the end.
    """
    return rollout.evaluate(*_arguments(trained, RunStage.EVALUATION, seed, episodes), events=trained.task.events)


def _arguments(trained: TrainedRun, stage: RunStage, seed: int, episodes: int) -> tuple[Any, ...]:
    """What the programs of evaluation and recording take."""
    make_env = environment_of(trained.task, trained.settings.reward)
    config, key = evaluation_config(trained), stage_key(seed, stage)
    return config, make_env, trained.reward_params, trained.policy, key, episodes


def compile_evaluation(shapes: TrainedRun, episodes: int) -> None:
    """Compiles the program of `unseen_episodes`, for parameters of these shapes and dtypes."""
    arguments = _arguments(shapes, RunStage.EVALUATION, 0, episodes)
    rollout.evaluate.lower(*arguments, events=shapes.task.events).compile()


def compile_recording(shapes: TrainedRun, episodes: int) -> None:
    """Compiles the program of `show_policy`, for parameters of these shapes and dtypes."""
    arguments = _arguments(shapes, RunStage.RECORDING, 0, episodes)
    rollout.record_frames.lower(shapes.task, *arguments, None).compile()


def show_policy(run: Run, trained: TrainedRun, episodes: int, seed: int, video: Path) -> None:
    """Writes the video of a few episodes and the plot of their rewards.

    Args:
      run: folder that gets the plot.
      trained: the policy with its task, settings and reward.
      episodes: number of episodes.
      seed: selects the episodes.
      video: file of the video, ends in .mp4.
    """
    task, settings = trained.task, trained.settings
    recorded = rollout.record(task, *_arguments(trained, RunStage.RECORDING, seed, episodes))
    write_video(rollout.draw_rollout(task, recorded), video, task.frame_rate)
    plots.reward_over_time(
        recorded.rewards,
        np.full(len(recorded.rewards), recorded.rewards.shape[1]),
        recorded.events,
        task.event_names,
        task.frame_rate,
        run.figures / "reward_on_rollouts.png",
        f"Reward ({settings.reward}) on the policy's own episodes",
    )


def evaluation_config(trained: TrainedRun) -> PPOConfig:
    """The run's PPO configuration with the task's full episode length."""
    return replace(trained.settings.ppo_config, episode_length=trained.task.episode_length)
