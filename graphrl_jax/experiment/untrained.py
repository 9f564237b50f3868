"""Evaluation of policies that have learned nothing, to look at a task or a reward before any training."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from graphrl_jax.encoder.pooling import PoolingParams
from graphrl_jax.experiment.environments import environment_of, reward_like
from graphrl_jax.experiment.evaluation import averages
from graphrl_jax.experiment.keys import RunStage, stage_key
from graphrl_jax.reward.model import RewardModel
from graphrl_jax.rl import ppo, rollout
from graphrl_jax.rl.actors import Actor, policy_named
from graphrl_jax.rl.config import PPOConfig
from graphrl_jax.rl.wrappers import EnvironmentReward
from graphrl_jax.task import Task
from graphrl_jax.viz.video import write_video


class Untrained(NamedTuple):
    """A policy that has learned nothing, with its task and reward.

    Attributes:
      task: the task.
      config: length of episodes, and how often the policy decides.
      make_env: see `environment_of`.
      reward_params: parameters of the reward.
      actor: the policy.
    """

    task: Task
    config: PPOConfig
    make_env: Callable[[Any], EnvironmentReward]
    reward_params: Any
    actor: Actor


def untrained(task: Task, policy: str, model: RewardModel | None = None) -> Untrained:
    """A policy in a task.

    Args:
      task: the task.
      policy: one of `POLICIES`. The expert decides in every control step, the others as seldom as trained ones.
      model: pays the reward, with a card; default: the task pays its own.

    Raises:
      ValueError: the policy is unknown, the task has no expert that acts, or the model is of other objects.
    """
    actor = policy_named(policy, task)
    config = PPOConfig(
        episode_length=task.episode_length, decision_steps=1 if policy == "expert" else task.decision_steps
    )
    if model is None:
        return Untrained(task, config, environment_of(task, "env"), ppo.as_float32(PoolingParams()), actor)
    if model.card is None or model.card.objects != task.objects:
        raise ValueError(f"the reward model has other objects than task {task.name}; allowed: {task.objects.names}")
    return Untrained(task, config, environment_of(task, reward_like(model)), model, actor)


def evaluate_untrained(untrained: Untrained, episodes: int, seed: int) -> dict[str, Any]:
    """As `evaluate_policy`, on the same episodes."""
    _, config, make_env, reward_params, actor = untrained
    key = stage_key(seed, RunStage.EVALUATION)
    outcomes = rollout.evaluate(config, make_env, reward_params, None, key, episodes, make_actor=lambda _: actor)
    return averages(outcomes, seed)


def show_untrained(untrained: Untrained, episodes: int, seed: int, video: Path) -> None:
    """Writes the video of a few episodes, the same ones as `show_policy`.

    Args:
      untrained: the policy.
      episodes: number of episodes.
      seed: selects the episodes.
      video: file of the video, ends in .mp4.
    """
    task, config, make_env, reward_params, actor = untrained
    key = stage_key(seed, RunStage.RECORDING)
    recorded = rollout.record(task, config, make_env, reward_params, None, key, episodes, make_actor=lambda _: actor)
    write_video(rollout.draw_rollout(task, recorded), video, task.frame_rate)
