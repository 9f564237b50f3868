"""`graphrl train`: a whole run; see `requests.Train`."""

from dataclasses import replace
from pathlib import Path
from typing import Any

from graphrl_jax import runtime
from graphrl_jax.cli.options import asked_for, refuse_other, refuse_useless
from graphrl_jax.cli.requests import STOP_AT, Train
from graphrl_jax.experiment import experiment, sharding
from graphrl_jax.experiment.experiment import Extent, Member
from graphrl_jax.experiment.run_directory import Run
from graphrl_jax.experiment.settings import compose
from graphrl_jax.experiment.trackers import tracker_named
from graphrl_jax.experiment.tracking import Tracking
from graphrl_jax.progress import Progress
from graphrl_jax.registry import make_task

SHOWN = ("success_rate", "mean_score", "episodes", "mean_return", "seed")


def run(request: Train) -> dict[str, Any]:
    """Carries the request out."""
    process_log = runtime.configure()
    _refuse_useless(request)
    # Processes that train together have the same numbers.
    tracker = tracker_named(request.track) if request.track is not None and request.process == 0 else None
    if request.coordinator is not None or request.processes > 1:
        request = _joined(request)
    member = _resumed(request) if request.resume else _started(request)
    task = make_task(member.settings.task, member.settings.engine)
    with Progress() as progress:
        progress.note(f"run directory: {member.run.path}")
        extent = Extent(resumed=request.resume)
        with Tracking(member.run, tracker, progress.note) as tracking:
            (summary,) = experiment.run([member], task, progress, process_log, extent)
            tracking.results(summary)
    shown = {name: summary[name] for name in SHOWN}
    return {"out": str(member.run.path), **shown, "wall_s": round(process_log.times()["wall_s"], 1)}


def _refuse_useless(request: Train) -> None:
    if request.coordinator is None and request.processes == 1:
        refuse_useless(request, ["process"], "without --processes above 1")
    if request.resume:
        refuse_useless(request, ["ablate"], "with --resume, which goes on with the run's own settings")
    elif request.reward == "env":
        refuse_useless(request, ["demos"], "with --reward env, which learns no reward")


def _joined(request: Train) -> Train:
    """Joins the other processes; returns the request with the folder of this process."""
    for name in ("coordinator", "out"):
        if getattr(request, name) is None:
            raise ValueError(f"--{name} is missing; several processes need it")
    assert request.coordinator is not None and request.out is not None
    sharding.join(request.coordinator, request.processes, request.process)
    if request.process == 0:
        return request
    return replace(request, out=request.out.with_name(f"{request.out.name}.process_{request.process}"))


def _started(request: Train) -> Member:
    """A new run, validated before anything is written."""
    task = make_task(request.task, request.engine)
    settings = compose(
        task,
        request.reward,
        request.preset or runtime.default_preset(),
        request.seed,
        None if request.demos is None else str(request.demos),
        request.ablate,
        request.updates,
        request.engine,
        asked_for(request.pretrain),
        asked_for(request.ppo),
        STOP_AT if request.stop_at is None else request.stop_at,
    )
    experiment.refuse_impossible(task, settings)
    out = request.out or Path("runs") / f"{settings.task}_{settings.reward}_{settings.seed}"
    return Member(Run.start(out, settings), settings)


def _resumed(request: Train) -> Member:
    if request.out is None:
        raise ValueError("--resume needs --out: the folder of the run to continue")
    run = Run(request.out)
    settings = run.settings()
    names = ("task", "reward", "preset", "demos", "seed", "updates", "engine", "stop_at")
    own = {name: getattr(settings, name) for name in names}
    own["pretrain"] = vars(settings.pretrain) | vars(settings.pretrain_config)
    own["ppo"] = vars(settings.ppo) | vars(settings.ppo_config)
    refuse_other(request, own, run.path)
    return Member(run, settings)
