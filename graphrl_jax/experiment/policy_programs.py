"""The compiled programs that train policies, and what they take."""

from dataclasses import dataclass
from functools import cache
from threading import Lock
from typing import Any, NamedTuple

import jax
from jax.stages import Wrapped

from graphrl_jax.encoder.pooling import PoolingParams
from graphrl_jax.experiment import batching
from graphrl_jax.experiment.environments import TrainingParams, training_environment_of
from graphrl_jax.experiment.keys import RunStage, stage_key
from graphrl_jax.experiment.run_directory import Run
from graphrl_jax.experiment.settings import Settings
from graphrl_jax.pretrain.trainer import pooling_params
from graphrl_jax.rl.config import PPOHyper
from graphrl_jax.rl.ppo import TrainState, as_float32
from graphrl_jax.runtime import jit_physics
from graphrl_jax.storage import load_tree, save_tree
from graphrl_jax.task import Task


@dataclass(frozen=True)
class PolicyJob:
    """A policy to train on a reward, and the run folder for `policy.npz` and log lines."""

    run: Run
    settings: Settings
    reward_params: Any


class Inputs(NamedTuple):
    """Inputs of the training programs of one policy."""

    hyper: PPOHyper
    params: TrainingParams
    key: jax.Array


class PolicyPrograms:
    """The compiled programs of policies that differ in floats and seeds, by the number of members side by side.

    Programs are compiled once, by whichever thread needs them first; others wait for it.
    """

    def __init__(self, settings: Settings, task: Task, reward_params: Any):
        """Compiles nothing yet.

        Args:
          settings: of any of the policies.
          task: task of all of them.
          reward_params: of any of them, or the shapes and dtypes of its leaves.
        """
        self.config, self.updates = settings.ppo_config, settings.updates
        self.chunk = min(settings.updates_per_chunk, settings.updates)
        self._make_starts = jit_physics(task.training_starts)  # one program for all jobs
        key = stage_key(settings.seed, RunStage.POLICY)
        self._shapes = jax.eval_shape(
            lambda hyper, reward, starts: Inputs(as_float32(hyper), TrainingParams(as_float32(reward), starts), key),
            settings.ppo,
            reward_params,
            self._make_starts.eval_shape(*_starts_inputs(settings)),
        )
        make_env = training_environment_of(task, settings.reward)
        self._made = cache(lambda count: batching.policy_programs(self.config, make_env, count))
        self._updates: dict[tuple[int, int], Any] = {}
        self._compiling = Lock()

    def inputs(self, job: PolicyJob) -> Inputs:
        """The inputs of a job."""
        params = TrainingParams(as_float32(job.reward_params), _starts(self._make_starts, job))
        return Inputs(as_float32(job.settings.ppo), params, stage_key(job.settings.seed, RunStage.POLICY))

    def init(self, count: int) -> Any:
        """The program (params, key) -> state."""
        return self._made(count)[0]

    def state_shapes(self, count: int) -> TrainState:
        """Shapes and dtypes of the state."""
        _, params, key = self._stacked(count)
        return self.init(count).eval_shape(params, key)

    def update(self, updates: int, count: int) -> Any:
        """The compiled program of `updates` updates: (hyper, params, state) -> (state, metrics)."""
        with self._compiling:
            if (updates, count) not in self._updates:
                hyper, params, _ = self._stacked(count)
                program = self._made(count)[1](updates)
                self._updates[updates, count] = program.lower(hyper, params, self.state_shapes(count)).compile()
            return self._updates[updates, count]

    def compile(self) -> None:
        """Compiles what the training of a single policy begins with."""
        self.update(self.chunk, 1)

    def _stacked(self, count: int) -> Inputs:
        return jax.eval_shape(batching.stack, [self._shapes] * count)


def _starts_inputs(settings: Settings) -> tuple[jax.Array, PoolingParams]:
    """Arguments of `Task.training_starts`."""
    pooling = pooling_params(settings.pretrain_config, settings.pretrain)
    return stage_key(settings.seed, RunStage.STARTS), pooling


def _starts(make_starts: Wrapped, job: PolicyJob) -> Any:
    """The training starts of a run, kept in its folder: another machine would resume from others."""
    kept, inputs = job.run.path / "starts.npz", _starts_inputs(job.settings)
    if kept.exists():
        return load_tree(kept, make_starts.eval_shape(*inputs))
    starts = make_starts(*inputs)
    if starts is not None:
        save_tree(kept, starts)
    return starts
