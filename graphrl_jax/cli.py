"""The command line: `train.py` and `python -m graphrl_jax {demos,import,pretrain,evaluate,stages,sweep}`.

A request that cannot be carried out (bad file, unknown name, a folder that holds another run) is one sentence on
standard error and exit code 2, and nothing is overwritten.
"""

import json
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import jax
import numpy as np
import tyro

from graphrl_jax import compilation, demonstrations, devices, pipeline, plots, recording, runs, training
from graphrl_jax.detection import ultralytics
from graphrl_jax.encoder import EncoderConfig
from graphrl_jax.importers.convert import Source, demonstrations_of, track_recording
from graphrl_jax.overlay import overlay
from graphrl_jax.pretrain import PretrainConfig, PretrainHyper
from graphrl_jax.progress import Progress
from graphrl_jax.runs import Run, RunError
from graphrl_jax.settings import Settings, default_preset
from graphrl_jax.sweep_command import Sweep, sweep
from graphrl_jax.task import Task, make_task
from graphrl_jax.training import PolicyJob, train_policies
from graphrl_jax.video import write_video

Demos = Annotated[Path | None, tyro.conf.arg(help="demonstration file; the expert makes them if none is given")]


@dataclass(frozen=True)
class Train:
    """Learn a reward from demonstrations and train a policy on it.

    Attributes:
      task: Registered task.
      reward: graph (robot left out of the pooling), graph_with_robot, a baseline (graphirl, graphirl_with_robot, or
        xirl, which sees pictures), or env (the task's own reward).
      preset: smoke, cpu or gpu; chosen for the device if left out.
      demos: Demonstration file; the expert makes them if none is given.
      alpha: Weight of objects that have moved (Eq. 1).
      seed: Everything random follows from it.
      ablate: What of the method to leave out: reconstruction, activity (alpha 1), persistence, edges.
      tcc: Variant of the soft TCC: regression_mse, regression_mse_var, regression_huber or classification.
      updates: Policy updates; the preset's number if left out.
      encoder_steps: Steps of pretraining; the preset's number if left out.
      out: Folder of the run; runs/TASK_REWARD_SEED if left out.
      resume: Continue the run in --out from its last checkpoint; its own settings are used.
      coordinator: Address and port of the first of several processes that train together, such as localhost:12345.
      processes: How many they are.
      process: Which of them this is, from 0; those above 0 need --out, and keep their copy in OUT.process_N.
    """

    task: str = "match_regions"
    reward: str = "graph"
    preset: str | None = None
    demos: Path | None = None
    alpha: float = 2.0
    seed: int = 0
    ablate: tuple[str, ...] = ()
    tcc: str = "regression_mse"
    updates: int | None = None
    encoder_steps: int | None = None
    out: Path | None = None
    resume: bool = False
    coordinator: str | None = None
    processes: int = 1
    process: int = 0


@dataclass(frozen=True)
class MakeDemos:
    """Write expert demonstrations, and deliberate failures, to a file.

    Attributes:
      out: File to write (.npz); must not exist.
      task: Registered task.
      num: Successful demonstrations.
      failures: Deliberate failures, of every kind in turn.
      pictures: Keep every frame's picture, so many pixels square; for encoders of pictures.
      seed: Everything random follows from it.
    """

    out: Path
    task: str = "match_regions"
    num: int = 64
    failures: int = 0
    pictures: int | None = None
    seed: int = 0


@dataclass(frozen=True)
class Pretrain:
    """Train an encoder alone and audit its reward.

    Attributes:
      demos: Demonstration file.
      out: Folder of the run.
      alpha: Weight of objects that have moved (Eq. 1).
      with_robot: Keep the robot's node in the pooling.
      steps: Optimiser steps.
      seed: Everything random follows from it.
    """

    demos: Path
    out: Path
    alpha: float = 2.0
    with_robot: bool = False
    steps: int = PretrainConfig().steps
    seed: int = 0


@dataclass(frozen=True)
class Evaluate:
    """Evaluate a run's policy on unseen episodes: one JSON line, and a video.

    Attributes:
      run: Folder of the run.
      episodes: Number of episodes.
      seed: Decides the episodes.
      video_episodes: Episodes shown in the video; 0 writes none.
      out: Video file; evaluation_SEED.mp4 in the run's folder if left out.
    """

    run: tyro.conf.Positional[Path]
    episodes: int = 256
    seed: int = 7
    video_episodes: int = 2
    out: Path | None = None


@dataclass(frozen=True)
class Import:
    """Make a demonstration file of recordings: videos, folders of frames, MAGICAL's .pkl.gz, or ready-made boxes.

    Attributes:
      source: File or folder; one demonstration per video, per folder of frames or labels, per .pkl.gz.
      out: File to write (.npz); must not exist.
      task: Registered task whose objects are in it.
      format: magical, frames, video, yolo, corners or coco; told by the files' names if left out.
      size: Width and height of the pictures, for corner files.
      frame_rate: Frames per second; the videos' own if left out, else the task's.
      weights: Weights of an Ultralytics model that finds the objects; the task's own detector if left out.
      overlay: Video to write of the first demonstration: boxes, names, and in orange what has moved.
    """

    source: tyro.conf.Positional[Path]
    out: Path
    task: str = "match_regions"
    format: str | None = None
    size: tuple[int, int] | None = None
    frame_rate: float | None = None
    weights: Path | None = None
    overlay: Path | None = None


@dataclass(frozen=True)
class Stages:
    """Find the stages of demonstrations by a run's encoder; they need no labels.

    Attributes:
      run: Folder of a run of `train` or `pretrain`.
      demos: Demonstration file.
      method: rests (of the embedding), change_points (of the reward) or uvd (of the embedding).
      out: JSON file to write; stages.json in the run's folder if left out.
    """

    run: tyro.conf.Positional[Path]
    demos: Path
    method: str = pipeline.STAGE_METHODS[0]
    out: Path | None = None


def train_main(args: list[str] | None = None) -> None:
    """Entry point of `train.py`."""
    _run(lambda: train(tyro.cli(Train, args=args)))


def main(args: list[str] | None = None) -> None:
    """Entry point of `python -m graphrl_jax`."""
    commands: dict[str, tuple[type, Callable[[Any], None]]] = {
        "demos": (MakeDemos, make_demos),
        "import": (Import, import_demos),
        "pretrain": (Pretrain, pretrain),
        "evaluate": (Evaluate, evaluate),
        "stages": (Stages, find_stages),
        "sweep": (Sweep, sweep),
    }

    def run() -> None:
        requests = {name: request for name, (request, _) in commands.items()}
        request = tyro.extras.subcommand_cli_from_dict(requests, args=args)
        dict(commands.values())[type(request)](request)

    _run(run)


def _run(action: Callable[[], None]) -> None:
    try:
        action()
    except (ValueError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        raise SystemExit(2) from None


def train(request: Train) -> None:
    """A whole run; see `Train`."""
    started = time.perf_counter()
    if request.coordinator is not None or request.processes > 1:
        request = _joined(request)
    compile_log = compilation.configure()
    run, settings = _resumed(request) if request.resume else _started(request)
    task = make_task(settings.task)
    numbers: dict[str, Any] = {}
    with Progress() as progress:
        progress.note(f"run directory: {run.path}")
        if settings.reward == "env":
            reward_params = pipeline.saved_reward(run, settings, task)
        else:
            demos = _demonstrations(run, task, settings)
            trained = (run.path / "encoder.json").exists()
            if devices.agreed(trained, "whether the encoder is trained"):
                numbers["encoder"] = runs.read_json(run.path / "encoder.json")
                reward_params = pipeline.saved_reward(run, settings, task)
            else:
                reward_params, numbers["encoder"] = training.train_encoder(
                    run, demos, settings.pretraining, settings.pretrain, settings.seed, progress
                )
                numbers["encoder"] |= pipeline.audit_reward(run, task, reward_params, demos, settings.seed)
                runs.write_json(run.path / "encoder.json", numbers["encoder"])
        ((policy, trained),) = train_policies([PolicyJob(run, settings, reward_params)], task, progress)
        progress.note("evaluating")
        episodes = settings.sizes.episodes
        outcome = pipeline.evaluate_policy(task, settings, reward_params, policy, episodes, settings.seed + 1000)
        _show_policy(run, task, settings, reward_params, policy, settings.seed + 1000, 2, run.path / "rollout.mp4")
    summary = {
        **outcome,
        **trained,
        "wall_s": time.perf_counter() - started,
        "compile_s": compile_log.seconds,
        "compilation_cache": compile_log.cache,
        "resumed": request.resume,
        **numbers,
        "training_seed": settings.seed,
        "reward": settings.reward,
        "versions": runs.versions(),
        "device": runs.device(),
    }
    runs.write_json(run.path / "summary.json", summary)
    print(json.dumps({"out": str(run.path), **outcome, "wall_s": round(summary["wall_s"], 1)}))


def _joined(request: Train) -> Train:
    """Joins the other processes; the request with the folder of this one."""
    for name in ("coordinator", "out"):
        if getattr(request, name) is None:
            raise ValueError(f"--{name} is missing; several processes need it")
    assert request.coordinator is not None and request.out is not None
    devices.join(request.coordinator, request.processes, request.process)
    if request.process == 0:
        return request
    return replace(request, out=request.out.with_name(f"{request.out.name}.process_{request.process}"))


def make_demos(request: MakeDemos) -> None:
    """See `MakeDemos`."""
    compilation.configure()
    _refuse_existing(request.out)
    for name, least in (("num", 1), ("failures", 0), ("pictures", 1)):
        value = getattr(request, name)
        if value is not None and value < least:
            raise ValueError(f"--{name} is {value}; allowed: {least} or more")
    drawn = {} if request.pictures is None else {"picture_size": request.pictures}
    made = make_task(request.task).demonstrate(jax.random.key(request.seed), request.num, request.failures, **drawn)
    made.save(request.out)
    print(json.dumps({"out": str(request.out), "demonstrations": len(made), "successes": int(made.success.sum())}))


def import_demos(request: Import) -> None:
    """See `Import`."""
    _refuse_existing(request.out)
    if request.overlay is not None and (request.overlay.suffix != ".mp4" or request.overlay.exists()):
        raise RunError(f"--overlay {request.overlay} must end in .mp4 and not exist yet")
    if request.frame_rate is not None and not 0 < request.frame_rate < float("inf"):
        raise ValueError(f"--frame-rate is {request.frame_rate}; allowed: numbers above 0")
    task = make_task(request.task)
    source = Source(request.source, request.format, request.size)
    detector = task.picture_detector() if request.weights is None else ultralytics(request.weights, task.objects)
    tracks, first, rates = [], None, set()
    with Progress() as progress:
        for recording in source.recordings(task.objects):
            tracks.append((*track_recording(recording, task.objects, detector), recording.success))
            first = recording.frames if first is None else first
            rates |= {recording.frame_rate} - {None}
            progress.note(f"{recording.source}: {len(tracks[-1][0])} frames")
    if request.overlay is not None and first is None:
        raise ValueError(f"--overlay {request.overlay}: the source has boxes alone, no pictures")
    if request.frame_rate is None and len(rates) > 1:
        raise ValueError(f"the videos have {sorted(rates)} frames per second; --frame-rate says which to take for all")
    rate = request.frame_rate or next(iter(rates), task.frame_rate)
    demos = demonstrations_of(tracks, task.objects, rate, task.name, str(request.source))
    demos.save(request.out)
    if request.overlay is not None:
        write_video(overlay(first, demos.select([0]), PretrainHyper().tau), request.overlay, demos.frame_rate)
    seen = float(np.mean(demos.mask[np.arange(demos.num_frames) < demos.lengths[:, None]].any(0)))
    print(json.dumps({"out": str(request.out), "demonstrations": len(demos), "slots seen": round(seen, 3)}))


def pretrain(request: Pretrain) -> None:
    """See `Pretrain`."""
    compilation.configure()
    demos = demonstrations.load(request.demos)
    task = make_task(demos.task)
    config = PretrainConfig(steps=request.steps)
    hyper = pipeline.pretrain_hyper(task, request.alpha, "graph_with_robot" if request.with_robot else "graph")
    run = Run.create(request.out, {"command": "pretrain", "task": demos.task, **runs.plain(asdict(request))})
    with Progress() as progress:
        model, numbers = training.train_encoder(run, demos, config, hyper, request.seed, progress)
        numbers |= pipeline.audit_reward(run, task, model, demos, request.seed)
    runs.write_json(run.path / "summary.json", {**numbers, "versions": runs.versions(), "device": runs.device()})
    print(json.dumps({"out": str(run.path), **{k: v for k, v in numbers.items() if isinstance(v, float)}}))


def evaluate(request: Evaluate) -> None:
    """See `Evaluate`."""
    compilation.configure()
    if request.episodes < 1:
        raise ValueError(f"--episodes is {request.episodes}; allowed: 1 or more")
    run = Run(request.run)
    trained = load_run(run)
    outcome = pipeline.evaluate_policy(*trained, request.episodes, request.seed)
    if request.video_episodes:
        video = request.out or run.path / f"evaluation_{request.seed}.mp4"
        _show_policy(run, *trained, request.seed, request.video_episodes, video)
    print(json.dumps(outcome))


def find_stages(request: Stages) -> None:
    """See `Stages`."""
    compilation.configure()
    run = Run(request.run)
    task = make_task(run.config["task"])
    demos = demonstrations.load(request.demos)
    if demos.objects != task.objects:
        raise ValueError(
            f"--demos {request.demos}: objects are {demos.objects.names}, but the run's {task.objects.names}"
        )
    trained = run.config.get("command") == "train"
    if trained:
        model = pipeline.saved_reward(run, _settings(run), task)
    else:
        model = pipeline.load_reward(run, EncoderConfig(), task)
    found = pipeline.demonstration_stages(model, demos, request.method)
    out = request.out or run.path / "stages.json"
    runs.write_json(out, {"demos": str(request.demos), "method": request.method, **found})
    print(json.dumps({"out": str(out), "demonstrations": len(demos), **found.get("judged", {})}))


def _refuse_existing(out: Path) -> None:
    if out.exists():
        raise RunError(f"--out {out} exists already; choose another name")


def load_run(run: Run) -> tuple[Task, Settings, Any, Any]:
    """Task, settings, reward parameters and policy of a finished run's directory."""
    settings = _settings(run)
    task = make_task(settings.task)
    reward_params = pipeline.saved_reward(run, settings, task)
    return task, settings, reward_params, pipeline.load_policy(run, task, settings, reward_params)


def _started(request: Train) -> tuple[Run, Settings]:
    """A new run and its settings, validated before anything is written."""
    task = make_task(request.task)
    hyper = pipeline.pretrain_hyper(task, request.alpha, request.reward, request.ablate)
    settings = Settings(
        task=request.task,
        reward=request.reward,
        preset=request.preset or default_preset(),
        seed=request.seed,
        demos=None if request.demos is None else str(request.demos),
        updates=request.updates,
        encoder_steps=request.encoder_steps,
        pretrain=hyper,
        ablations=request.ablate,
        tcc_variant=request.tcc,
    )
    pipeline.refuse_undrawn(task, settings.reward)
    if settings.demos is not None:
        pipeline.given_demonstrations(task, settings)
    out = request.out or Path("runs") / f"{settings.task}_{settings.reward}_{settings.seed}"
    return Run.create(out, {"command": "train", "version": runs.VERSION, **asdict(settings)}), settings


def _resumed(request: Train) -> tuple[Run, Settings]:
    if request.out is None:
        raise ValueError("--resume needs --out: the folder of the run to continue")
    run = Run(request.out)
    return run, _settings(run)


def _settings(run: Run) -> Settings:
    """The settings saved in a run's directory.

    Raises:
      RunError: there are none, or they are those of another version or command.
    """
    config = run.config
    if config.get("command") != "train" or config.get("version") != runs.VERSION:
        raise RunError(
            f"{run.path}/config.json is of command {config.get('command')!r}, version {config.get('version')!r}; "
            f"allowed: 'train', version {runs.VERSION}"
        )
    default = Settings()
    fields = {name: value for name, value in config.items() if name not in ("command", "version")}
    fields["pretrain"] = replace(default.pretrain, **fields["pretrain"])
    fields["ppo"] = replace(default.ppo, **fields["ppo"])
    fields["ablations"] = tuple(fields.get("ablations", ()))
    return Settings(**fields)


def _demonstrations(run: Run, task: Task, settings: Settings) -> demonstrations.Demonstrations:
    """The run's demonstrations, made once and kept beside it: a resumed run sees the same ones."""
    kept = run.path / "demonstrations.npz"
    if kept.exists():
        return demonstrations.load(kept)
    demos = pipeline.make_demonstrations(task, settings)
    demos.save(kept)
    return demos


def _show_policy(
    run: Run, task: Task, settings: Settings, reward_params: Any, policy: Any, seed: int, episodes: int, video: Path
) -> None:
    """Writes the video of a few episodes and the figure of their rewards."""
    recorded = recording.record(
        task, settings, reward_params, policy, pipeline.stage_key(seed, pipeline.RECORDING), episodes
    )
    recording.write_rollout_video(task, recorded, video)
    plots.reward_over_time(
        recorded.rewards,
        np.full(len(recorded.rewards), recorded.rewards.shape[1]),
        recorded.events,
        task.event_names,
        task.frame_rate,
        run.figures / "reward_on_rollouts.png",
        f"Reward ({settings.reward}) on the policy's own episodes",
    )
