"""Training encoders and policies with progress, logs and checkpoints: one, or a sweep's members side by side."""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import jax
import numpy as np

from graphrl_jax import devices, pipeline, plots, ppo, pretrain, sweep
from graphrl_jax.demonstrations import Demonstrations
from graphrl_jax.pretrain import PretrainConfig, PretrainHyper
from graphrl_jax.progress import Progress
from graphrl_jax.reward import RewardModel, fit_reward
from graphrl_jax.runs import Run, RunError, load_tree, read_json, save_tree, write_json
from graphrl_jax.settings import Settings
from graphrl_jax.task import Task


@dataclass(frozen=True)
class EncoderJob:
    """An encoder to train, and the folder that gets `encoder.npz` and log lines."""

    run: Run
    demonstrations: Demonstrations
    hyper: PretrainHyper
    seed: int


@dataclass(frozen=True)
class PolicyJob:
    """A policy to train on a reward, and the folder that gets `policy.npz` and log lines."""

    run: Run
    settings: Settings
    reward_params: Any


def train_encoders(
    jobs: Sequence[EncoderJob], config: PretrainConfig, progress: Progress
) -> list[tuple[RewardModel, dict[str, Any]]]:
    """Pretrains encoders on three quarters of the successes and fits their rewards; writes `encoder.npz` for each.

    Returns:
      per job its reward model, and numbers on the held-out quarter: kendall_tau, cycle_consistency,
      value_order_correlation; pretrain_s, the seconds of the optimiser's steps, compiling included, over all jobs.

    Raises:
      ValueError: jobs have demonstrations of different number or length.
    """
    splits = [job.demonstrations.successes().split(0.75, job.seed) for job in jobs]
    data = [pretrain.prepare(fitted, config.encoder.picture_size) for fitted, _ in splits]
    shapes = {(jax.tree.structure(one), one.mask.shape) for one in data}
    if len(shapes) > 1:
        raise ValueError(f"demonstrations trained on side by side must agree in number and length, got {shapes}")
    hypers = [ppo.as_float32(job.hyper) for job in jobs]
    keys = [pipeline.stage_key(job.seed, pipeline.PRETRAIN) for job in jobs]
    states = [pretrain.init(config, data[0].objects, key) for key in keys]
    chunk = max(1, config.steps // 10)
    for job in jobs:
        job.run.forget_after("pretrain", "step", 0)
    started = time.perf_counter()

    def program_for(steps: int, count: int) -> Any:
        arguments = (sweep.stack(part[:count]) for part in (hypers, data, states))
        return sweep.pretrain_program(config, steps, count).lower(*arguments).compile()

    size, program = sweep.fit(lambda count: program_for(chunk, count), len(jobs))
    programs = {chunk: program}
    lies = devices.per_member(devices.mesh_for(size, len(jax.devices())), size)
    members = sweep.groups(range(len(jobs)), size)
    progress.begin("pretraining", config.steps * len(members))
    if len(jobs) > 1:
        progress.note(f"{len(jobs)} encoders, {size} side by side")
    for group in members:
        stacked = tuple(sweep.stack([part[i] for i in group]) for part in (hypers, data, states))
        hyper, shown, state = devices.put(stacked, lies)
        for done in range(0, config.steps, chunk):
            steps = min(chunk, config.steps - done)
            if steps not in programs:
                programs[steps] = program_for(steps, size)
            state, history = programs[steps](hyper, shown, state)
            means = sweep.unstack(jax.tree.map(lambda values: values.mean(-1), devices.to_host(history)), size)
            for i, record in _each_once(group, means):
                numbers = {name: float(value) for name, value in record.items()}
                jobs[i].run.log({"stage": "pretrain", "step": done + steps, **numbers})
            progress.advance(steps, loss=float(np.mean([m["loss"] for m in means])))
        for i, member in _each_once(group, sweep.unstack(devices.to_host(state), size)):
            states[i] = member
    seconds = time.perf_counter() - started
    rewards = [_fit_reward(config, *row) for row in zip(jobs, splits, data, states, strict=True)]
    return [(model, {**numbers, "pretrain_s": seconds}) for model, numbers in rewards]


def train_encoder(
    run: Run,
    demonstrations: Demonstrations,
    config: PretrainConfig,
    hyper: PretrainHyper,
    seed: int,
    progress: Progress,
) -> tuple[RewardModel, dict[str, Any]]:
    """`train_encoders` for one."""
    return train_encoders([EncoderJob(run, demonstrations, hyper, seed)], config, progress)[0]


def _fit_reward(
    config: PretrainConfig,
    job: EncoderJob,
    split: tuple[Demonstrations, Demonstrations],
    data: pretrain.PretrainData,
    state: pretrain.PretrainState,
) -> tuple[RewardModel, dict[str, float]]:
    """The reward of a trained encoder, saved, and its numbers on held-out demonstrations."""
    fitted, held_out = split
    hyper = job.hyper
    shown = pretrain.shown_frames(config, ppo.as_float32(hyper), data, pipeline.stage_key(job.seed, pipeline.GOAL))
    weights = (hyper.alpha, hyper.suppress_robot, hyper.tau)
    floats = (hyper.even, hyper.robot_messages)
    static = (config.persistent, config.encoder.picture_size)
    model = fit_reward(state.params["encoder"], fitted, *weights, shown, *floats, *static)
    save_tree(job.run.path / "encoder.npz", model)
    return model, pipeline.encoder_numbers(model, held_out)


def train_policies(
    jobs: Sequence[PolicyJob], task: Task, progress: Progress, folder: Path | None = None
) -> list[tuple[Any, dict[str, Any]]]:
    """PPO in compiled chunks, with log lines and a checkpoint after each; continues from a checkpoint if there is one.

    Args:
      jobs: alike in reward and sizes.
      task: that of all of them.
      progress: shows where it is.
      folder: for checkpoints of several jobs; that of one job lies in its own folder.

    Returns:
      per job the policy's parameters, and env_steps, train_steps_per_s and the seconds spent.
    """
    first = jobs[0].settings
    sizes = first.sizes
    config, _ = pipeline.ppo_settings(task, first)
    hypers = [ppo.as_float32(pipeline.ppo_settings(task, job.settings)[1]) for job in jobs]
    keys = [pipeline.stage_key(job.settings.seed, pipeline.POLICY) for job in jobs]
    rewards = [ppo.as_float32(job.reward_params) for job in jobs]
    make_env = pipeline.environment_of(task.training(), first.reward)

    programs = cache(lambda count: sweep.policy_programs(config, make_env, count))

    @cache
    def program_for(updates: int, count: int) -> Any:
        hyper, reward, key = (sweep.stack(part[:count]) for part in (hypers, rewards, keys))
        init, make_updates = programs(count)
        return make_updates(updates).lower(hyper, reward, init.eval_shape(reward, key)).compile()

    chunk = min(sizes.updates_per_chunk, sizes.updates)
    if folder is not None and (folder / "groups.json").exists():
        size = read_json(folder / "groups.json")["size"]  # checkpoints are of such groups
    else:
        size, _ = sweep.fit(lambda count: program_for(chunk, count), len(jobs))
    if folder is None:
        _refuse_lost_checkpoint(jobs[0].run)
    else:
        write_json(folder / "groups.json", {"size": size})
    members = sweep.groups(range(len(jobs)), size)
    progress.begin("training the policy", sizes.updates * len(members))
    if len(jobs) > 1:
        progress.note(f"{len(jobs)} policies, {size} side by side")
    trained: dict[int, tuple[Any, dict[str, Any]]] = {}
    mesh = devices.mesh_for(size, config.num_envs)
    for number, group in enumerate(members):
        stacked = tuple(sweep.stack([part[i] for i in group]) for part in (hypers, rewards, keys))
        hyper, reward, key = devices.put(stacked, devices.per_member(mesh, size))
        state = programs(size)[0](reward, key)
        checkpoint = jobs[0].run.path / "train_state.npz" if folder is None else folder / f"policies_{number}.npz"
        policies: dict[int, Any] = {}
        kept = load_tree(checkpoint, state) if checkpoint.exists() else None
        done = devices.agreed(0 if kept is None else int(np.ravel(kept.updates)[0]), "progress of the training")
        if kept is not None:
            state = devices.put(kept, devices.of_train_state(mesh, size))
            # An interruption may have come between the checkpoint and these.
            policies = _save_policies(jobs, group, kept)
        for i in set(group):
            jobs[i].run.forget_after("ppo", "update", done)
        progress.advance(done)
        seconds, timed, since = 0.0, 0, done
        while done < sizes.updates:
            count = min(sizes.updates_per_chunk, sizes.updates - done)
            program = program_for(count, size)
            started = time.perf_counter()
            state, metrics = program(hyper, reward, state)
            records = [ppo.average_metrics(member) for member in sweep.unstack(jax.tree.map(np.asarray, metrics), size)]
            elapsed = time.perf_counter() - started
            done += count
            if done > since + count or count == sizes.updates - since:  # the first chunk warms up
                seconds, timed = seconds + elapsed, timed + count
            steps_per_s = size * count * config.steps_per_update / elapsed
            for i, record in _each_once(group, records):
                jobs[i].run.log({"stage": "ppo", "update": done, "env_steps": done * config.steps_per_update,
                                 "steps_per_s": steps_per_s, **{k: float(v) for k, v in record.items()}})  # fmt: skip
            on_host = devices.to_host(state)
            save_tree(checkpoint, on_host)
            policies = _save_policies(jobs, group, on_host)
            shown = [name for name in ("success", "score", "reward") if name in records[0]]
            means = {name: float(np.nanmean([record[name] for record in records])) for name in shown}
            progress.advance(count, **{"steps/s": steps_per_s}, **means)
        rate = size * timed * config.steps_per_update / seconds if seconds else None
        numbers = {"env_steps": done * config.steps_per_update, "train_steps_per_s": rate}
        for i, policy in policies.items():
            plots.learning_curve(jobs[i].run.records("ppo"), jobs[i].run.figures / "learning_curve.png")
            trained[i] = policy, numbers
    return [trained[i] for i in range(len(jobs))]


def _save_policies(jobs: Sequence[PolicyJob], group: Sequence[int], state: ppo.TrainState) -> dict[int, Any]:
    """Writes `policy.npz` for every job of a group whose state is on the host; the policies by job."""
    policies = dict(_each_once(group, sweep.unstack(ppo.policy_params(state), len(group))))
    for i, policy in policies.items():
        save_tree(jobs[i].run.path / "policy.npz", policy)
    return policies


def _refuse_lost_checkpoint(run: Run) -> None:
    """Training would begin anew and overwrite a policy, such as that of a sweep's member.

    Raises:
      RunError: the folder has a policy, but nothing to go on from.
    """
    if (run.path / "policy.npz").exists() and not (run.path / "train_state.npz").exists():
        raise RunError(
            f"{run.path} holds policy.npz, but no train_state.npz to go on from; a sweep is resumed as a whole"
        )


def _each_once(group: Sequence[int], members: Sequence[Any]) -> list[tuple[int, Any]]:
    """Pairs of job and member; a group is filled up with its last job."""
    return list(dict(zip(reversed(group), reversed(members), strict=True)).items())
