"""Reader of LeRobotDatasets, v2.1 and v3.0, by their parquet files and videos alone."""

import io
from collections import Counter
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from graphrl_jax.perception.importers.clips import (
    Clip,
    read_clips,
    refuse_other_times,
    refuse_overlaps,
    video_frames,
)
from graphrl_jax.perception.importers.datasets import whole
from graphrl_jax.perception.importers.images import read_image
from graphrl_jax.perception.importers.lerobot_metadata import Episode, Info, camera_of, read_episodes, read_info
from graphrl_jax.perception.importers.parquet import read_columns, stream_column
from graphrl_jax.perception.importers.recording import ImportFailure, Recording, Recordings
from graphrl_jax.perception.importers.subtask_labels import has_subtasks, subtask_ends

_SUCCESS = "next.success"


def info_files(files: Sequence[Path]) -> list[Path]:
    """The files `meta/info.json` of LeRobotDatasets."""
    return [
        path
        for path in files
        if (path.parent.name, path.name) == ("meta", "info.json") and b"codebase_version" in path.read_bytes()
    ]


def read_lerobot(files: list[Path], camera: str | None) -> Recordings:
    """Yields a recording per episode of each dataset.

    Args:
      files: the datasets' `meta/info.json`.
      camera: name of a feature of pictures; None takes the only one.

    Raises:
      ImportFailure: see `read_info`, `camera_of` and `read_episodes`; or rows or frames are not as the metadata say.
    """
    for path in files:
        yield from _read_dataset(read_info(path), camera)


def _read_dataset(info: Info, asked: str | None) -> Recordings:
    camera = camera_of(info, asked)
    episodes = read_episodes(info, camera)
    starts, successes = _rows(info, episodes)
    stored = zip(episodes, starts, strict=True)
    clips = [episode.clip or Clip(episode.data, start, start + episode.length) for episode, start in stored]
    refuse_overlaps(clips)
    notes: dict[int, list[str]] = {episode.index: [] for episode in episodes}
    if camera.is_video:
        _check_videos(info, clips, notes)
        frames = read_clips(clips, camera.size, video_frames, lambda frame, _: frame)
    else:
        frames = read_clips(clips, camera.size, partial(stream_column, name=camera.key), _picture)
    events = subtask_ends([episode.row for episode in episodes])
    for episode in episodes:
        if has_subtasks(episode.row) and events[episode.index] is None:
            notes[episode.index].append("subtasks left out, as other episodes have none")
    for episode, pictures in zip(episodes, frames, strict=True):
        yield Recording(
            info.folder / f"episode_{episode.index}",
            pictures,
            success=successes[episode.index],
            frame_rate=info.frame_rate,
            notes=tuple(notes[episode.index]),
            events=events[episode.index],
        )


def _check_videos(info: Info, clips: Sequence[Clip], notes: Mapping[int, list[str]]) -> None:
    """Refuses videos that are not as the metadata say; notes frames that are of no episode."""
    inside: dict[Path, list[int]] = {}
    for index, clip in enumerate(clips):
        inside.setdefault(clip.path, []).append(index)
    for path, indices in inside.items():
        count = refuse_other_times(path, info.frame_rate, clips[indices[-1]].stop)
        left = count - sum(clips[index].stop - clips[index].start for index in indices)
        if left:
            notes[indices[0]].append(f"{path.relative_to(info.folder)}: {left} frames of no episode left out")


def _rows(info: Info, episodes: Sequence[Episode]) -> tuple[list[int], list[bool]]:
    """The row in its data file at which each episode begins, and whether it is a success."""
    by_file: dict[Path, list[Episode]] = {}
    for episode in episodes:
        by_file.setdefault(episode.data, []).append(episode)
    starts, successes = [0] * len(episodes), [True] * len(episodes)
    required = ["episode_index", "frame_index", *([_SUCCESS] if _SUCCESS in info.features else [])]
    for path, inside in by_file.items():
        columns = read_columns(path, required, ["index", "timestamp"])
        begins = _begins(path, columns["episode_index"], inside)
        for episode in inside:
            starts[episode.index] = begins[episode.index]
            _check_rows(path, columns, begins[episode.index], episode, info.frame_rate)
            if _SUCCESS in columns:
                row = begins[episode.index] + episode.length - 1
                successes[episode.index] = _truth(columns[_SUCCESS][row], f"{path}: row {row}: {_SUCCESS}")
    return starts, successes


def _begins(path: Path, listed: Sequence[Any], inside: Sequence[Episode]) -> dict[int, int]:
    """The first row of each episode of a data file, by the episode of each row.

    Raises:
      ImportFailure: an episode has not as many rows as frames, or rows are of no episode of this file.
    """
    begins: dict[int, int] = {}
    for row, index in enumerate(listed):
        begins.setdefault(whole(index, f"{path}: row {row}: episode_index"), row)
    counts = Counter(listed)
    for episode in inside:
        if counts[episode.index] != episode.length:
            raise ImportFailure(
                f"{path}: it has {counts[episode.index]} rows of episode {episode.index}; allowed: {episode.length}, "
                "the episode's length"
            )
    foreign = begins.keys() - {episode.index for episode in inside}
    if foreign:
        raise ImportFailure(f"{path}: it has rows of episode {min(foreign)}; allowed: those that the metadata say")
    return begins


def _check_rows(path: Path, columns: Mapping[str, list], start: int, episode: Episode, frame_rate: float) -> None:
    """Refuses rows of an episode that are not its frames, one after the other."""
    for number in range(episode.length):
        expected = {"episode_index": episode.index, "frame_index": number, "index": episode.first + number}
        for name, value in expected.items():
            if name in columns and columns[name][start + number] != value:
                raise ImportFailure(
                    f"{path}: row {start + number}: {name} is {columns[name][start + number]}; allowed: {value}"
                )
        time = columns["timestamp"][start + number] if "timestamp" in columns else number / frame_rate
        if not isinstance(time, float) or not abs(time * frame_rate - number) < 0.5:
            raise ImportFailure(
                f"{path}: row {start + number}: timestamp is {time}; allowed: {number / frame_rate:g}, as there are "
                f"{frame_rate:g} frames per second"
            )


def _truth(value: Any, what: str) -> bool:
    """A flag, alone or in a list."""
    value = value[0] if isinstance(value, list) and len(value) == 1 else value
    if value not in (0, 1):
        raise ImportFailure(f"{what} is {value!r}; allowed: true and false")
    return bool(value)


def _picture(cell: Any, where: str) -> np.ndarray:
    """A picture (H, W, 3) uint8 of a cell that embeds its file."""
    value = cell.as_py()
    raw = value.get("bytes") if isinstance(value, dict) else None
    if not isinstance(raw, bytes):
        raise ImportFailure(f"{where}: the picture is not in the file; allowed: pictures embedded as bytes")
    return read_image(io.BytesIO(raw), where)
