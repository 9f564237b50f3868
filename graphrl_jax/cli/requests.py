"""The request of each command. Plain Python, so that help is fast."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import tyro

from graphrl_jax.cli.options import choice, optional, overrides
from graphrl_jax.experiment.methods import ABLATIONS, METHODS
from graphrl_jax.experiment.presets import PRESETS
from graphrl_jax.experiment.trackers import TRACKERS
from graphrl_jax.perception.config import FORMATS
from graphrl_jax.pretrain.config import PretrainConfig, PretrainHyper
from graphrl_jax.registry import ENGINES, task_names
from graphrl_jax.reward.config import SUBTASK_METHODS
from graphrl_jax.rl.config import POLICIES, PPOConfig, PPOHyper

TaskName = Annotated[str, choice(task_names())]
RewardName = Annotated[str, choice(METHODS)]
PresetName = Annotated[str | None, optional(f"{{{','.join(PRESETS)}}}", "cpu, or gpu where there is one")]
EngineName = Annotated[str | None, optional(f"{{{','.join(ENGINES)}}}", "the fastest on this device")]
DemosFile = Annotated[Path | None, optional("PATH", "the expert makes them")]
TrackerName = Annotated[str | None, optional(f"{{{','.join(TRACKERS)}}}", "nothing is tracked")]
Ablations = Annotated[tuple[str, ...], tyro.conf.arg(metavar=f"[{{{','.join(ABLATIONS)}}} ...]")]
Updates = Annotated[int | None, optional("INT", "the preset's")]

STOP_AT = 0.99
"""Share of unseen episodes at which `graphrl train` ends by default."""
RESOLVED = ("encoder", "activity", "nodes")
"""Fields of configs that follow from method, ablations and task, and are no options."""
FOLLOWING = {
    "decay_updates": "all updates",
    "episode_length": "the task's",
    "decision_steps": "the task's",
    "nodes": "the task's",
}
"""Fields of PPO whose default follows from other settings."""
_PRETRAIN = overrides(
    "PretrainOptions",
    {PretrainHyper: "", PretrainConfig: "the preset's"},
    left_out=RESOLVED,
    aliases={"alpha": "--alpha", "steps": "--encoder-steps", "tcc_loss": "--tcc"},
)
_ENCODER = overrides(
    "EncoderOptions",
    {PretrainHyper: "", PretrainConfig: "the cpu preset's"},
    left_out=RESOLVED,
    aliases={"alpha": "--alpha", "steps": "--steps", "tcc_loss": "--tcc"},
)
_PPO = overrides(
    "PPOOptions",
    {PPOHyper: "", PPOConfig: "the preset's"},
    left_out=RESOLVED,
    aliases={"policy": "--policy"},
    defaults=FOLLOWING,
)


PretrainOptions = Annotated[Any, tyro.conf.arg(constructor=_PRETRAIN)]
EncoderOptions = Annotated[Any, tyro.conf.arg(constructor=_ENCODER)]
PPOOptions = Annotated[Any, tyro.conf.arg(constructor=_PPO)]


@dataclass(frozen=True)
class Train:
    """Learns a reward from demonstrations and trains a policy on it.

    Attributes:
      task: registered task.
      reward: reward that the policy is trained on; env is the task's own reward.
      preset: sizes of the run.
      demos: demonstration file.
      seed: source of all randomness.
      ablate: parts of the method to leave out.
      updates: policy updates.
      engine: physics engine of the task.
      stop_at: end the training once the policy solves this share of unseen episodes twice in a row; 0 for never.
      out: folder of the run.
      resume: continue the run in --out from its last checkpoint, with its own settings.
      track: experiment tracker that gets the run's metrics, figures and video; with --resume also those of before.
      coordinator: address and port of the first of several processes that train together, such as localhost:12345.
      processes: number of processes.
      process: index of this process, from 0; processes above 0 write to OUT.process_N.
      pretrain: sizes and floats of pretraining; task and reward may have other defaults.
      ppo: sizes and floats of PPO.
    """

    task: TaskName = "match_regions"
    reward: RewardName = "graph"
    preset: PresetName = None
    demos: DemosFile = None
    seed: int = 0
    ablate: Ablations = ()
    updates: Updates = None
    engine: EngineName = None
    stop_at: Annotated[float | None, optional("FLOAT", f"{STOP_AT}")] = None
    out: Annotated[Path | None, optional("PATH", "runs/TASK_REWARD_SEED")] = None
    resume: bool = False
    track: TrackerName = None
    coordinator: Annotated[str | None, optional("HOST:PORT", "this process trains alone")] = None
    processes: int = 1
    process: int = 0
    pretrain: PretrainOptions = field(default_factory=_PRETRAIN)
    ppo: PPOOptions = field(default_factory=_PPO)


@dataclass(frozen=True)
class Demos:
    """Writes expert demonstrations and deliberate failures to a file.

    Attributes:
      out: file to write (.npz); must not exist.
      task: registered task.
      num: number of successful demonstrations.
      failures: number of deliberate failures, of every kind in turn.
      images: store an image of every frame, with this edge in pixels; for encoders of images.
      seed: source of all randomness.
      engine: physics engine of the task.
    """

    out: Path
    task: TaskName = "match_regions"
    num: int = 64
    failures: int = 0
    images: Annotated[int | None, optional("INT", "boxes alone")] = None
    seed: int = 0
    engine: EngineName = None


@dataclass(frozen=True)
class Pretrain:
    """Trains an encoder alone and audits its reward.

    Attributes:
      demos: demonstration file.
      out: folder of the run.
      reward: method of the encoder.
      seed: source of all randomness.
      ablate: parts of the method to leave out.
      pretrain: sizes and floats of pretraining; task and reward may have other defaults.
    """

    demos: Path
    out: Path
    reward: Annotated[str, choice(name for name, method in METHODS.items() if method.encoder)] = "graph"
    seed: int = 0
    ablate: Ablations = ()
    pretrain: EncoderOptions = field(default_factory=_ENCODER)


@dataclass(frozen=True)
class Evaluate:
    """Evaluates a policy on unseen episodes; prints one JSON line and writes a video.

    Attributes:
      run: folder of the run; with --policy, the name of a registered task.
      policy: a policy that has learned nothing, to look at the task or at a reward.
      reward_model: pays the reward of --policy; a folder or a model on the hub, as for `graphrl score`.
      episodes: number of episodes.
      seed: seed of the episodes.
      video_episodes: episodes shown in the video; 0 writes none.
      engine: physics engine of the task; it may differ from the training's.
      out: video file.
    """

    run: tyro.conf.Positional[Path]
    policy: Annotated[str | None, optional(f"{{{','.join(POLICIES)}}}", "the run's")] = None
    reward_model: Annotated[Path | None, optional("PATH", "the task's own reward")] = None
    episodes: int = 256
    seed: int = 7
    video_episodes: int = 2
    engine: EngineName = None
    out: Annotated[
        Path | None, optional("PATH", "evaluation_SEED.mp4 in the run's folder; with --policy TASK_POLICY_SEED.mp4")
    ] = None


@dataclass(frozen=True)
class Import:
    """Makes a demonstration file from recordings: videos, frames, datasets of robots, ready-made boxes or masks.

    Attributes:
      source: file or folder; one demonstration per video, per sequence of frames or labels in a folder, per .pkl.gz,
        per episode of a dataset.
      out: file to write (.npz); must not exist.
      task: registered task of the recordings.
      objects: file of objects (.toml), for a task that is not registered; `graphrl objects` writes one.
      format: format of the source.
      size: width and height of the images, for corner files and labels in pixels that do not say it.
      camera: camera of the dataset, such as observation.images.top; for lerobot and robomimic.
      frame_rate: frames per second; recordings of another rate are resampled to it.
      weights: weights of an Ultralytics model that finds the objects.
      overlay: video file to write, the first demonstration with boxes and names; moved objects are orange.
    """

    source: tyro.conf.Positional[Path]
    out: Path
    task: TaskName = "match_regions"
    objects: Annotated[Path | None, optional("PATH", "the task's")] = None
    format: Annotated[str | None, optional(f"{{{','.join(FORMATS)}}}", "told by the files")] = None
    size: Annotated[tuple[int, int] | None, optional("INT INT", "the source says it")] = None
    camera: Annotated[str | None, optional("NAME", "the only one")] = None
    frame_rate: Annotated[float | None, optional("FLOAT", "the videos' own, else the task's")] = None
    weights: Annotated[Path | None, optional("PATH", "the task's own detector")] = None
    overlay: Annotated[Path | None, optional("PATH", "none is written")] = None


@dataclass(frozen=True)
class Objects:
    """Writes a file of objects (.toml) to fill in, for recordings of a task that is not registered.

    Attributes:
      out: file to write; must not exist.
      labels: labels of the objects, as the detector or the labels call them.
      classes: export whose classes are the labels: YOLO's .yaml, classes.txt or obj.names, COCO's .json, or a folder.
    """

    out: Path
    labels: Annotated[tuple[str, ...], tyro.conf.arg(metavar="[STR ...]")] = ()
    classes: Annotated[Path | None, optional("PATH", "--labels")] = None


@dataclass(frozen=True)
class Stages:
    """Finds the subtasks of demonstrations with a run's encoder; no labels are needed.

    Attributes:
      run: folder of a run of `train` or `pretrain`, or of a reward model; or owner/name of a model on the hub.
      demos: demonstration file.
      method: rule that finds boundaries; rests and uvd use the embedding, change_points the reward.
      out: JSON file to write; one that exists is replaced.
    """

    run: tyro.conf.Positional[Path]
    demos: Path
    method: Annotated[str, choice(SUBTASK_METHODS)] = SUBTASK_METHODS[0]
    out: Annotated[Path | None, optional("PATH", "subtasks.json in that folder, or here")] = None


@dataclass(frozen=True)
class Score:
    """Scores recordings under a reward model: progress per frame, subtasks, and a ranking.

    Attributes:
      model: folder of a reward model, or of a run that learned one; or owner/name of a model on the Hugging Face Hub.
      source: file or folder of recordings; see `graphrl import`.
      out: folder to write; must not exist.
      objects: file of objects with the colours of the model's objects.
      format: format of the source.
      size: width and height of the images, for corner files and labels in pixels that do not say it.
      camera: camera of the dataset, such as observation.images.top; for lerobot and robomimic.
      weights: weights of an Ultralytics model that finds the objects.
    """

    model: tyro.conf.Positional[Path]
    source: tyro.conf.Positional[Path]
    out: Path
    objects: Annotated[Path | None, optional("PATH", "the task's detector")] = None
    format: Annotated[str | None, optional(f"{{{','.join(FORMATS)}}}", "told by the files")] = None
    size: Annotated[tuple[int, int] | None, optional("INT INT", "the source says it")] = None
    camera: Annotated[str | None, optional("NAME", "the only one")] = None
    weights: Annotated[Path | None, optional("PATH", "the task's own detector")] = None


@dataclass(frozen=True)
class Report:
    """Writes one HTML page about a run: its numbers, curves, landscape, exploits, subtasks, video, and what it missed.

    Attributes:
      run: folder of a run of `train` or `pretrain`, or of a member of a sweep.
      out: HTML file to write; one that exists is replaced.
    """

    run: tyro.conf.Positional[Path]
    out: Annotated[Path | None, optional("PATH", "report.html in the run's folder")] = None


@dataclass(frozen=True)
class Sweep:
    """Trains encoders and policies for several values of some floats, times seeds, side by side.

    Attributes:
      out: folder of the sweep; each member is a run folder in it.
      task: registered task.
      reward: reward that policies are trained on; with env there are no encoders.
      preset: sizes of each run.
      demos: demonstration file.
      alphas: weights of moved objects, such as 1,2,4,8,16; short for --sweep pretrain.alpha=1,2,4,8,16.
      sweep: fields and values, such as pretrain.reconstruction_weight=0.1,1 ppo.learning_rate=3e-4,1e-3.
      seeds: number of seeds.
      first_seed: first seed.
      updates: policy updates.
      engine: physics engine of the task.
      encoders_only: train and audit encoders, no policies.
      resume: continue the sweep in --out, with its own settings.
      pretrain: sizes and floats of pretraining, of every member; task and reward may have other defaults.
      ppo: sizes and floats of PPO, of every member.
    """

    out: Path
    task: TaskName = "match_regions"
    reward: RewardName = "graph"
    preset: PresetName = None
    demos: DemosFile = None
    alphas: Annotated[str | None, optional("FLOAT,FLOAT,...", "not swept")] = None
    sweep: Annotated[tuple[str, ...], tyro.conf.arg(metavar="[FIELD=FLOAT,FLOAT,... ...]")] = ()
    seeds: int = 1
    first_seed: int = 0
    updates: Updates = None
    engine: EngineName = None
    encoders_only: bool = False
    resume: bool = False
    pretrain: PretrainOptions = field(default_factory=_PRETRAIN)
    ppo: PPOOptions = field(default_factory=_PPO)
