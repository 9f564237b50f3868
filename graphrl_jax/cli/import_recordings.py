"""`graphrl import`: demonstrations from recordings; see `requests.Import`."""

import math
from typing import Any

import numpy as np

from graphrl_jax import runtime
from graphrl_jax.cli.options import refuse_existing, refuse_useless
from graphrl_jax.cli.requests import Import
from graphrl_jax.cli.sources import detector_of, source_of
from graphrl_jax.demonstrations import Demonstrations
from graphrl_jax.perception.importers.convert import demonstrations_of, tracks_of
from graphrl_jax.perception.importers.recording import same_rate
from graphrl_jax.perception.objects_file import read_objects
from graphrl_jax.pretrain.config import PretrainHyper
from graphrl_jax.progress import Progress
from graphrl_jax.registry import make_task
from graphrl_jax.viz.drawing import overlay
from graphrl_jax.viz.video import write_video


def run(request: Import) -> dict[str, Any]:
    """Carries the request out."""
    runtime.configure()
    _check(request)
    recorded = None if request.objects is None else read_objects(request.objects)
    task = recorded or make_task(request.task)
    source = source_of(request)
    detector = detector_of(request, task.objects, task.detector())
    tracks, events, first, rates = [], [], None, set()
    with Progress() as progress:
        for track in tracks_of(
            source, task.objects, detector, request.frame_rate or (recorded and recorded.frame_rate)
        ):
            recording = track.recording
            if recording.frames is None:
                refuse_useless(request, ["weights"], "where the source has boxes, no images")
            tracks.append((track.boxes, track.mask, recording.success))
            events.append(recording.events)
            first = recording.frames if first is None else first
            rates |= {recording.frame_rate} - {None}
            read = f"{recording.source}: {len(track.mask)} frames"
            progress.note("; ".join([read, *recording.notes, *track.notes]))
    if request.overlay is not None and first is None:
        raise ValueError(f"--overlay {request.overlay}: the source has boxes alone, no images")
    rate = _frame_rate(request.frame_rate, rates, task.frame_rate)
    demos = demonstrations_of(tracks, task.objects, rate, task.name, str(request.source), events)
    demos.save(request.out)
    if request.overlay is not None:
        write_video(overlay(first, demos.select([0]), PretrainHyper().tau), request.overlay, demos.frame_rate)
    return {"out": str(request.out), "demonstrations": len(demos), "slots seen": round(_share_seen(demos), 3)}


def _check(request: Import) -> None:
    """Checks the request before anything is read."""
    refuse_existing(request.out)
    if request.objects is not None:
        refuse_useless(request, ["task"], "with --objects, which say what the task's objects are")
    if request.overlay is not None and (request.overlay.suffix != ".mp4" or request.overlay.exists()):
        raise ValueError(f"--overlay {request.overlay} must end in .mp4 and not exist yet")
    if request.frame_rate is not None and not 0 < request.frame_rate < math.inf:
        raise ValueError(f"--frame-rate is {request.frame_rate}; allowed: numbers above 0")


def _frame_rate(asked: float | None, found: set[float], usual: float) -> float:
    """Frames per second: the requested rate, else that of the videos, else that of the task."""
    if asked is None and found and not same_rate(min(found), max(found)):
        raise ValueError(f"the videos have {sorted(found)} frames per second; --frame-rate says which to take for all")
    return asked or min(found, default=usual)


def _share_seen(demos: Demonstrations) -> float:
    """Share of the slots that hold an object in at least one frame."""
    return float(np.mean(demos.mask[np.arange(demos.num_frames) < demos.lengths[:, None]].any(0)))
