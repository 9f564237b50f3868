"""`graphrl score`: progress of recordings under a reward model; see `requests.Score`."""

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from graphrl_jax import runtime
from graphrl_jax.cli.options import refuse_useless
from graphrl_jax.cli.requests import Score
from graphrl_jax.cli.sources import detector_of, source_of
from graphrl_jax.perception.detector import Detector
from graphrl_jax.perception.importers.convert import tracks_of
from graphrl_jax.perception.objects_file import read_objects
from graphrl_jax.progress import Progress
from graphrl_jax.registry import make_task, task_names
from graphrl_jax.reward.annotations import subtasks_of, write_subtasks, write_table
from graphrl_jax.reward.card import Card
from graphrl_jax.reward.model import RewardModel
from graphrl_jax.reward.scoring import Curve, at_times, score, summary
from graphrl_jax.storage import write_json
from graphrl_jax.viz.page import spread
from graphrl_jax.viz.score_page import Scored, scores_page

_SHOWN = ("recording", "final_progress", "value_order_correlation", "looks_like_success")


def run(request: Score) -> dict[str, Any]:
    """Carries the request out."""
    runtime.configure()
    if request.out.exists():
        raise ValueError(f"--out {request.out} exists already; choose another name")
    model = RewardModel.load(request.model)
    card = model.card
    assert card is not None
    source = source_of(request)
    tables, rows, shown, subtasks, index = [], [], [], [], 0
    with Progress() as progress:
        for number, track in enumerate(tracks_of(source, card.objects, _detector(request, card), card.frame_rate)):
            if track.recording.frames is None:
                refuse_useless(request, ["weights", "objects"], "where the source has boxes, no images")
            curve = score(model, track.boxes, track.mask)
            own_rate = track.source_rate or card.frame_rate
            times = np.arange(track.source_length) / own_rate
            tables.append(_table(at_times(curve, card.frame_rate, times), times, number, index, card))
            index += len(times)
            subtasks.append(subtasks_of(curve.subtask, track.shown, track.source_length, own_rate))
            recording, about = track.recording.source, {"episode_index": number, **summary(model, curve)}
            rows.append({"recording": str(recording), **about})
            name = _name(recording, request.source)
            shown.append(Scored(name, about, curve.progress, card.frame_rate, spread(track.recording.frames)))
            progress.note("; ".join([str(track.recording.source), *track.recording.notes, *track.notes]))
    if not rows:
        raise ValueError(f"{request.source} holds no recordings")
    told = {"reward_model_path": str(request.model)}
    write_table(request.out / "progress.parquet", pa.concat_tables(tables).replace_schema_metadata(told))
    write_subtasks(request.out, subtasks)
    order = sorted(range(len(rows)), key=lambda number: rows[number]["final_progress"], reverse=True)
    ranked = [rows[number] for number in order]
    source_name, model_name = request.source.resolve().name, request.model.resolve().name
    page, title = request.out / "report.html", f"Progress of {source_name}, scored by the reward model {model_name}"
    scores_page(page, [shown[number] for number in order], title, card.demonstrations, card.source, card.end_reward)
    write_json(
        request.out / "scores.json", {"model": str(request.model), "end_reward": card.end_reward, "recordings": ranked}
    )
    return {"out": str(request.out), "recordings": [{name: row[name] for name in _SHOWN} for row in ranked]}


def _name(recording: Path, source: Path) -> str:
    """A recording's path inside its source."""
    inside = recording.is_relative_to(source) and recording != source
    return str(recording.relative_to(source)) if inside else recording.name


def _detector(request: Score, card: Card) -> Detector:
    """What finds the objects in images: a trained model, the colours of a file of objects, or the task's own."""
    if request.objects is None:
        own = make_task(card.task).detector() if card.task in task_names() else None
        return detector_of(request, card.objects, own)
    found = read_objects(request.objects)
    if found.objects != card.objects:
        raise ValueError(f"--objects {request.objects} has other objects than {request.model}")
    return detector_of(request, card.objects, found.detector())


def _table(curve: Curve, times: np.ndarray, episode: int, first: int, card: Card) -> pa.Table:
    """A row per frame of a recording, which are at `times`."""
    frames = np.arange(len(times))
    return pa.table(
        {
            "index": pa.array(first + frames, pa.int64()),
            "episode_index": pa.array(np.full(len(frames), episode), pa.int64()),
            "frame_index": pa.array(frames, pa.int64()),
            "progress_sparse": pa.array(curve.progress, pa.float32()),
            "seconds": pa.array(times, pa.float32()),
            "distance": pa.array(curve.distance, pa.float32()),
            "reward": pa.array(curve.reward, pa.float32()),
            "subtask": pa.array(curve.subtask, pa.int64()),
            "active": pa.array(_names(curve.active, card), pa.list_(pa.string())),
            "found": pa.array(_names(curve.found, card), pa.list_(pa.string())),
        }
    )


def _names(flags: np.ndarray, card: Card) -> list[list[str]]:
    """Names of the objects whose flag is set, per frame."""
    return [[name for name, flag in zip(card.objects.names, row, strict=True) if flag] for row in flags]
