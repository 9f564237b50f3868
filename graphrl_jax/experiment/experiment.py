"""The whole pipeline, for one run or for many side by side:

    demonstrations -> encoder -> reward -> audit -> policy -> evaluation -> summary

Results that a run directory already holds are reused, so that an interrupted run continues.
"""

import shutil
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from graphrl_jax import demonstrations as demonstration_files
from graphrl_jax.demonstrations import DemonstrationError, Demonstrations
from graphrl_jax.experiment import ahead, sharding
from graphrl_jax.experiment.audit import audit_reward
from graphrl_jax.experiment.checkpoints import TrainedRun, load_reward_params, reward_shapes
from graphrl_jax.experiment.environments import drawer_of, refuse_undrawn
from graphrl_jax.experiment.evaluation import CHECK_OFFSET, SEED_OFFSET, evaluate_policy, show_policy
from graphrl_jax.experiment.keys import RunStage, stage_key
from graphrl_jax.experiment.policy_programs import PolicyJob, PolicyPrograms
from graphrl_jax.experiment.run_directory import Run
from graphrl_jax.experiment.settings import Settings
from graphrl_jax.experiment.train_encoder import EncoderJob, train_encoders
from graphrl_jax.experiment.train_policy import train_policies
from graphrl_jax.graph import ObjectTable
from graphrl_jax.pretrain.config import PretrainHyper
from graphrl_jax.progress import Progress
from graphrl_jax.reward.card import MODEL, Card, read_card, write_card
from graphrl_jax.runtime import ProcessLog, device, versions
from graphrl_jax.storage import read_json, write_atomically, write_json
from graphrl_jax.task import Task

VIDEO_EPISODES = 2
LEAST_SUCCESSES = 3
"""Soft TCC needs pairs, and at least one success is held out."""
ENCODER_FILES = (MODEL, "encoder.json")


@dataclass(frozen=True)
class Member:
    """One run: its folder and its settings."""

    run: Run
    settings: Settings


@dataclass(frozen=True)
class Extent:
    """Extent of `run`.

    Attributes:
      policies: train and evaluate policies as well as encoders.
      videos: draw a few episodes of every policy.
      resumed: the runs were started earlier.
    """

    policies: bool = True
    videos: bool = True
    resumed: bool = False


def refuse_impossible(task: Task, settings: Settings, members: int = 1) -> None:
    """Refuses settings that cannot work, before anything is written.

    Args:
      task: task of the run.
      settings: settings of the run, or of one of `members` runs that differ in floats and seeds.
      members: number of runs side by side.

    Raises:
      ValueError: the reward needs images, and the task draws none; the environments do not fit the devices; or the
        task's episodes, which policies are evaluated on, are not whole decisions.
      DemonstrationError: see `given_demonstrations`.
    """
    sharding.mesh_for(members, settings.ppo_config.num_envs)
    steps = settings.ppo_config.decision_steps
    if task.episode_length % steps:
        raise ValueError(
            f"decision_steps is {steps}; allowed: divisors of the {task.episode_length} steps of {task.name}'s episodes"
        )
    refuse_undrawn(task, settings.reward, settings.pretrain.rearranged)
    if settings.demos is not None:
        given_demonstrations(task, settings)


def run(
    members: Sequence[Member],
    task: Task,
    progress: Progress,
    process_log: ProcessLog,
    extent: Extent,
    folder: Path | None = None,
) -> list[dict[str, Any]]:
    """Runs the pipeline for one member, or for many side by side.

    Args:
      members: runs with the same task, reward and sizes.
      task: task of all members.
      progress: progress display.
      process_log: seconds of this process.
      extent: see `Extent`.
      folder: folder for checkpoints of several members.

    Returns:
      The summary of each member. With policies it is also written into the member's folder.

    Raises:
      RunError, StorageError: a folder holds files that training cannot continue from.
      ValueError: processes disagree on what is done, or members cannot be trained side by side.
    """
    finished = extent.policies and all((member.run.path / "summary.json").exists() for member in members)
    if sharding.agreed(finished, "whether the run is finished"):
        return [read_json(member.run.path / "summary.json") for member in members]
    settings = members[0].settings
    summaries: list[dict[str, Any]] = [{} for _ in members]
    programs = PolicyPrograms(settings, task, reward_shapes(settings, task)) if extent.policies else None
    with ahead.compiling(_ahead(members, task, extent, programs)):
        if settings.method.encoder is not None:
            summaries = [{"encoder": metrics} for metrics in _encoders(members, task, progress)]
        if programs is None:
            return summaries
        outcomes = _policies(members, task, progress, extent, folder, programs)
    for member, summary, outcome in zip(members, summaries, outcomes, strict=True):
        summary |= outcome | {
            "training_seed": member.settings.seed,
            "reward": member.settings.reward,
            "resumed": extent.resumed,
            "versions": versions(),
            "device": device(),
        }
        if len(members) == 1:  # the seconds of many side by side say nothing about one of them
            summary |= process_log.times()
        write_json(member.run.path / "summary.json", summary)
    return summaries


def _ahead(
    members: Sequence[Member], task: Task, extent: Extent, programs: PolicyPrograms | None
) -> list[ahead.Compile]:
    """What is compiled while the encoder of a single run is trained."""
    settings, run = members[0].settings, members[0].run
    learns = settings.method.encoder is not None and not (run.path / "encoder.json").exists()
    if programs is None or len(members) > 1 or not learns:
        return []
    episodes = VIDEO_EPISODES if extent.videos else 0
    return ahead.programs_of(settings, task, reward_shapes(settings, task), programs, episodes)


def load_demonstrations(path: str | Path, objects: ObjectTable, frame_rate: float, task: str) -> Demonstrations:
    """Loads a demonstration file; one at another frame rate is resampled.

    Args:
      path: the file.
      objects: the objects that it should have.
      frame_rate: frames per second.
      task: name of the task, for messages.

    Raises:
      DemonstrationError: the file is not a demonstration file, or has other objects.
    """
    loaded = demonstration_files.load(path)
    for field in fields(objects):
        found, expected = getattr(loaded.objects, field.name), getattr(objects, field.name)
        if found != expected:
            raise DemonstrationError(f"{path}: {field.name} is {found}, but task {task} has {expected}")
    return loaded if loaded.frame_rate == frame_rate else loaded.resampled(frame_rate)


def given_demonstrations(task: Task, settings: Settings) -> Demonstrations:
    """Loads the demonstrations of the file in `settings.demos`.

    Raises:
      DemonstrationError: the file is not a demonstration file, has other objects, too few successes or a demonstration
        of a single frame, or lacks the required images.
    """
    assert settings.demos is not None
    loaded = load_demonstrations(settings.demos, task.objects, task.frame_rate, task.name)
    successes, single = int(loaded.success.sum()), loaded.lengths < 2
    if successes < LEAST_SUCCESSES:
        raise DemonstrationError(
            f"{settings.demos} holds {successes} successes; allowed: {LEAST_SUCCESSES} or more, of which a quarter is "
            "held out"
        )
    if single.any():
        raise DemonstrationError(f"{settings.demos}: demonstration {single.argmax()} has 1 frame; allowed: 2 or more")
    size = settings.image_size
    if size is not None:
        try:
            loaded.images(size)
        except DemonstrationError as error:
            raise DemonstrationError(f"{settings.demos}: {error}; `demos --images {size}` makes them") from error
    return loaded


def make_demonstrations(task: Task, settings: Settings) -> Demonstrations:
    """Loads the given file of demonstrations, or runs the expert, with failures for the audit.

    Raises:
      DemonstrationError: see `given_demonstrations`.
    """
    if settings.demos is not None:
        return given_demonstrations(task, settings)
    count = settings.demonstrations
    key = stage_key(settings.seed, RunStage.DEMONSTRATIONS)
    return task.demonstrate(key, count, count // 4, settings.image_size)


def _keep_demonstrations(member: Member, members: Sequence[Member], task: Task) -> Path:
    """A member's demonstrations, made once per seed and kept in its folder, so that a resumed run uses the same."""
    kept = member.run.path / "demonstrations.npz"
    for sibling in members:
        made = sibling.run.path / "demonstrations.npz"
        if sibling.settings.seed == member.settings.seed and made.exists():
            _copy_missing(made, kept)
    if not kept.exists():
        make_demonstrations(task, member.settings).save(kept)
    return kept


def _encoders(members: Sequence[Member], task: Task, progress: Progress) -> list[dict[str, Any]]:
    """Trains and audits the missing encoders; members that differ only in PPO's floats share one.

    Returns:
      Per member the metrics of its encoder.
    """
    owners: dict[tuple[PretrainHyper, int], Member] = {}
    for member in members:
        owners.setdefault((member.settings.pretrain, member.settings.seed), member)
    missing = [one for one in owners.values() if not all((one.run.path / name).exists() for name in ENCODER_FILES)]
    if sharding.agreed(len(missing), "how many encoders are missing"):
        kept = [demonstration_files.load(_keep_demonstrations(one, members, task)) for one in missing]
        jobs = [
            EncoderJob(one.run, demos, one.settings.pretrain, one.settings.seed, drawer_of(task, one.settings))
            for one, demos in zip(missing, kept, strict=True)
        ]
        trained = train_encoders(jobs, members[0].settings.pretrain_config, progress)
        for one, job, (model, metrics) in zip(missing, jobs, trained, strict=True):
            progress.note(f"auditing {job.run.path.name}")
            metrics |= audit_reward(job, task, model, one.settings.step_discount)
            _write_encoder(job.run, model.card, metrics)
    for member in members:
        owner = owners[member.settings.pretrain, member.settings.seed]
        _keep_demonstrations(member, members, task)
        if not (member.run.path / "encoder.json").exists():
            _copy_missing(owner.run.path / MODEL, member.run.path / MODEL)
            _write_encoder(member.run, read_card(owner.run.path), read_json(owner.run.path / "encoder.json"))
    return [read_json(member.run.path / "encoder.json") for member in members]


def _write_encoder(run: Run, card: Card, metrics: dict[str, Any]) -> None:
    """Writes the card of a run's reward model, then the model's metrics, which say that it is finished."""
    write_card(run.path, card, metrics)
    write_json(run.path / "encoder.json", metrics)


def _policies(
    members: Sequence[Member],
    task: Task,
    progress: Progress,
    extent: Extent,
    folder: Path | None,
    programs: PolicyPrograms,
) -> list[dict[str, Any]]:
    """Trains and evaluates all policies; returns the outcomes per member."""
    rewards = [load_reward_params(member.run, member.settings, task) for member in members]
    jobs = [PolicyJob(m.run, m.settings, reward) for m, reward in zip(members, rewards, strict=True)]

    def solved(job: PolicyJob, policy: Any) -> float:
        found = TrainedRun(task, job.settings, job.reward_params, policy)
        return evaluate_policy(found, job.settings.episodes, job.settings.seed + CHECK_OFFSET)["success_rate"]

    trained = train_policies(jobs, task, progress, folder, solved, programs)
    progress.note("evaluating")
    outcomes = []
    for job, (policy, metrics) in zip(jobs, trained, strict=True):
        finished = TrainedRun(task, job.settings, job.reward_params, policy)
        seed = job.settings.seed + SEED_OFFSET
        outcomes.append(evaluate_policy(finished, job.settings.episodes, seed) | metrics)
        if extent.videos:
            show_policy(job.run, finished, VIDEO_EPISODES, seed, job.run.video)
    return outcomes


def _copy_missing(source: Path, target: Path) -> None:
    if not target.exists():
        write_atomically(target, lambda temporary: shutil.copyfile(source, temporary))
