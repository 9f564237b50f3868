"""Training of policies by PPO in compiled chunks with checkpoints, for one run or a sweep's members side by side."""

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import jax
import numpy as np

from graphrl_jax.experiment import batching, sharding
from graphrl_jax.experiment.policy_programs import Inputs, PolicyJob, PolicyPrograms
from graphrl_jax.experiment.run_directory import Run, RunError
from graphrl_jax.progress import Progress
from graphrl_jax.rl import ppo
from graphrl_jax.rl.ppo import TrainState
from graphrl_jax.storage import (
    has_generation,
    load_generation,
    read_json,
    save_generation,
    save_tree,
    write_json,
)
from graphrl_jax.task import Task
from graphrl_jax.viz import plots

_MOST_BAD = {"bad_envs": 0.01, "skipped_steps": 0.1}
"""Shares of control steps and of gradient steps that may fail before a training is stopped."""
_OFTEN, _IN_A_ROW = 0.5, 2
"""Share of solved training episodes from which a policy is evaluated, and evaluations in a row that end a training."""


Evaluate = Callable[[PolicyJob, Any], float]
"""From a job and its policy's parameters to the share of unseen episodes that the policy solves."""


def train_policies(
    jobs: Sequence[PolicyJob],
    task: Task,
    progress: Progress,
    folder: Path | None = None,
    evaluate: Evaluate | None = None,
    programs: PolicyPrograms | None = None,
) -> list[tuple[Any, dict[str, Any]]]:
    """Trains a policy for every job by PPO; continues from checkpoints if there are any.

    Args:
      jobs: jobs with the same reward and sizes.
      task: task of all jobs.
      progress: progress display.
      folder: folder for checkpoints of several jobs; if None, the checkpoint is in the job's own folder.
      evaluate: see `Evaluate`; by it a single training may end early, as its settings say. If None, none does.
      programs: those of the jobs, if some of them may be compiled already.

    Returns:
      Per job the policy's parameters, and metrics: env_steps, train_steps_per_s.
    """
    programs = programs or PolicyPrograms(jobs[0].settings, task, jobs[0].reward_params)
    size = _group_size(programs, jobs, folder)
    groups = batching.groups(range(len(jobs)), size)
    progress.begin("training the policy", jobs[0].settings.updates * len(groups))
    if len(jobs) > 1:
        progress.note(f"{len(jobs)} policies, {size} side by side")
    trained: dict[int, tuple[Any, dict[str, Any]]] = {}
    for number, group in enumerate(groups):
        checkpoint = jobs[0].run.path / "train_state.npz" if folder is None else folder / f"policies_{number}.npz"
        training = _Group(jobs, group, programs, checkpoint, progress, evaluate)
        metrics = training.train()
        trained |= {i: (policy, metrics) for i, policy in training.policies.items()}
    for job in jobs:
        plots.learning_curve(job.run.records("ppo"), job.run.figures / "learning_curve.png")
    return [trained[i] for i in range(len(jobs))]


def _group_size(programs: PolicyPrograms, jobs: Sequence[PolicyJob], folder: Path | None) -> int:
    """Members per group: as many as fit into memory, or the group size of the folder's checkpoints.

    Raises:
      RunError: see `_refuse_lost_checkpoint`.
    """
    kept = None if folder is None else folder / "groups.json"
    if kept is not None and kept.exists():
        return read_json(kept)["size"]
    size, _ = batching.fit(lambda count: programs.update(programs.chunk, count), len(jobs))
    if kept is None:
        _refuse_lost_checkpoint(jobs[0].run)
    else:
        write_json(kept, {"size": size})
    return size


def _refuse_lost_checkpoint(run: Run) -> None:
    """Refuses a training that would start anew and overwrite a policy, such as that of a sweep's member.

    Raises:
      RunError: the folder has a policy but no checkpoint.
    """
    if (run.path / "policy.npz").exists() and not has_generation(run.path / "train_state.npz"):
        raise RunError(
            f"{run.path} holds policy.npz, but no train_state.npz to go on from; a sweep is resumed as a whole"
        )


class _Group:
    """Members that train side by side in one program.

    Attributes:
      policies: parameters of the latest policies by job.
    """

    def __init__(
        self,
        jobs: Sequence[PolicyJob],
        group: Sequence[int],
        programs: PolicyPrograms,
        checkpoint: Path,
        progress: Progress,
        evaluate: Evaluate | None,
    ):
        self.jobs, self.group, self.programs = jobs, group, programs
        self.checkpoint, self.progress, self.evaluate = checkpoint, progress, evaluate
        self.policies: dict[int, Any] = {}
        self.size = len(group)
        self.stop_at = jobs[0].settings.stop_at if evaluate and len(jobs) == 1 else 0.0

    def train(self) -> dict[str, Any]:
        """Trains from the checkpoint to the end; returns env_steps, and the rate without the warm-up chunk."""
        config, updates, chunk = self.programs.config, self.programs.updates, self.programs.chunk
        inputs, state, done = self._start()
        self.progress.advance(done)
        seconds, timed, since = 0.0, 0, done
        while done < updates and not self._solved():
            count = min(chunk, updates - done)
            program = self.programs.update(count, self.size)
            started = time.perf_counter()
            state, metrics = program(inputs.hyper, inputs.params, state)
            records = self._averages(metrics)
            elapsed = time.perf_counter() - started
            done += count
            if done > since + count or count == updates - since:  # without the first chunk, a warm-up
                seconds, timed = seconds + elapsed, timed + count
            self._log(records, done, count, self.size * count * config.steps_per_update / elapsed)
            self._refuse_divergence(records, done)
            self._save(sharding.to_host(state))
            self._judge(records, done)
        rate = self.size * timed * config.steps_per_update / seconds if seconds else None
        return {"env_steps": done * config.steps_per_update, "train_steps_per_s": rate}

    def _start(self) -> tuple[Inputs, TrainState, int]:
        """The placed inputs, the state of the checkpoint or a new one, and updates done."""
        mesh = sharding.mesh_for(self.size, self.programs.config.num_envs)
        stacked = batching.stack([self.programs.inputs(self.jobs[i]) for i in self.group])
        inputs = sharding.put(stacked, sharding.per_member(mesh, self.size))
        state = self.programs.init(self.size)(inputs.params, inputs.key)
        kept = self._kept(state)
        done = sharding.agreed(0 if kept is None else int(np.ravel(kept.updates)[0]), "progress of the training")
        if kept is not None:
            state = sharding.put(kept, sharding.of_train_state(mesh, self.size))
            # The run may have been interrupted after the checkpoint and before the policies were written.
            self._save_policies(kept)
        for i in set(self.group):
            for stage in ("ppo", "evaluation"):
                self.jobs[i].run.forget_after(stage, "update", done)
        return inputs, state, done

    def _judge(self, records: list[dict[str, np.ndarray]], done: int) -> None:
        """Evaluates the policy of a single training that may end early, once its own episodes are often solved."""
        if self.evaluate and self.stop_at and records[0].get("success", 0.0) >= _OFTEN:
            share = self.evaluate(self.jobs[0], self.policies[0])
            self.jobs[0].run.log({"stage": "evaluation", "update": done, "success_rate": share})

    def _solved(self) -> bool:
        """Whether the last evaluations of a single training end it."""
        if not self.stop_at:
            return False
        last = self.jobs[0].run.records("evaluation")[-_IN_A_ROW:]
        return len(last) == _IN_A_ROW and all(one["success_rate"] >= self.stop_at for one in last)

    def _kept(self, like: TrainState) -> TrainState | None:
        """The state of the checkpoint, if there is one."""
        if not has_generation(self.checkpoint):
            return None
        state, lost = load_generation(self.checkpoint, like)
        if lost:
            self.progress.note(lost)
        return state

    def _averages(self, metrics: ppo.Metrics) -> list[dict[str, np.ndarray]]:
        """Means over a chunk for each member; fetching them waits for the program."""
        members = batching.unstack(jax.tree.map(np.asarray, metrics), self.size)
        return [ppo.average_metrics(member) for member in members]

    def _refuse_divergence(self, records: list[dict[str, np.ndarray]], done: int) -> None:
        """Stops a training of which too much is not finite; its last checkpoint stays.

        Raises:
          RunError: see above.
        """
        for i, record in batching.each_once(self.group, records):
            for name, most in _MOST_BAD.items():
                if not record[name] <= most:
                    raise RunError(
                        f"the training in {self.jobs[i].run.path} diverges: {name} is {float(record[name]):.3g} up to "
                        f"update {done} (allowed: {most}); metrics.jsonl shows since when, and --resume goes on from "
                        f"the last checkpoint"
                    )

    def _log(self, records: list[dict[str, np.ndarray]], done: int, count: int, steps_per_s: float) -> None:
        env_steps = done * self.programs.config.steps_per_update
        for i, record in batching.each_once(self.group, records):
            where = {"stage": "ppo", "update": done, "env_steps": env_steps, "steps_per_s": steps_per_s}
            self.jobs[i].run.log({**where, **{name: float(value) for name, value in record.items()}})
        shown = [name for name in ("success", "score", "reward") if name in records[0]]
        means = {name: float(np.nanmean([record[name] for record in records])) for name in shown}
        self.progress.advance(count, **{"steps/s": steps_per_s}, **means)

    def _save(self, state: TrainState) -> None:
        """Writes the checkpoint, then the policies."""
        save_generation(self.checkpoint, state)
        self._save_policies(state)

    def _save_policies(self, state: TrainState) -> None:
        """Writes `policy.npz` for every member; `state` is on the host."""
        self.policies = dict(batching.each_once(self.group, batching.unstack(ppo.policy_params(state), self.size)))
        for i, policy in self.policies.items():
            save_tree(self.jobs[i].run.path / "policy.npz", policy)
