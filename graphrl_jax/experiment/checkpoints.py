"""Loading of trained rewards and policies from run directories."""

from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np

from graphrl_jax.experiment.environments import environment_of
from graphrl_jax.experiment.run_directory import Run
from graphrl_jax.experiment.settings import Settings
from graphrl_jax.pretrain.trainer import pooling_params
from graphrl_jax.registry import make_task
from graphrl_jax.reward import model
from graphrl_jax.rl import ppo
from graphrl_jax.storage import load_tree
from graphrl_jax.task import Task


class TrainedRun(NamedTuple):
    """A finished run of `train`: its task, settings, reward parameters and policy parameters."""

    task: Task
    settings: Settings
    reward_params: Any
    policy: Any


def load_reward_params(run: Run, settings: Settings, task: Task) -> Any:
    """The reward parameters of a run of `train`: its `RewardModel`, or `PoolingParams` if no reward is learned.

    Raises:
      StorageError: see `load_parameters`.
    """
    config = settings.pretrain_config
    if settings.method.encoder is None:
        return reward_shapes(settings, task)
    return model.load_parameters(run.path, config.encoder, config.activity, task.objects)


def reward_shapes(settings: Settings, task: Task) -> Any:
    """The reward parameters of a run, with shapes and dtypes in the place of what is still to be learned."""
    config = settings.pretrain_config
    if settings.method.encoder is None:
        return jax.tree.map(np.float32, pooling_params(config, settings.pretrain))
    return model.shapes(config.encoder, config.activity, task.objects)


def load_policy(run: Run, task: Task, settings: Settings, reward_params: Any) -> Any:
    """The policy saved in a run's directory.

    Raises:
      StorageError: there is none, or it does not match the networks of the settings.
    """
    return load_tree(run.path / "policy.npz", policy_shapes(task, settings, reward_params))


def policy_shapes(task: Task, settings: Settings, reward_params: Any) -> Any:
    """Shapes and dtypes of a policy's parameters; those of the reward may be shapes, too."""
    make_env = environment_of(task, settings.reward)

    def policy(reward_params: Any) -> Any:
        return ppo.policy_params(ppo.init(settings.ppo_config, make_env, reward_params, jax.random.key(0)))

    return jax.eval_shape(policy, reward_params)


def load_run(path: str | Path, engine: str | None = None) -> TrainedRun:
    """A finished run of `train`, or a member of a sweep, from its folder.

    Args:
      path: folder of the run.
      engine: physics engine of the task; default: the fastest on this device.

    Raises:
      ValueError: the task is not registered, or cannot use the engine.
      RunError, StorageError: the folder holds no such run, or the run is not finished.
    """
    run = Run(path)
    settings = run.settings()
    task = make_task(settings.task, engine)
    reward_params = load_reward_params(run, settings, task)
    return TrainedRun(task, settings, reward_params, load_policy(run, task, settings, reward_params))
