"""Metadata of a LeRobotDataset, v2.1 or v3.0: its cameras, its episodes, and where their frames are."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate
from pathlib import Path, PureWindowsPath
from typing import Any

from graphrl_jax.perception.importers.clips import Clip
from graphrl_jax.perception.importers.datasets import chosen_camera, json_object, rate, whole
from graphrl_jax.perception.importers.parquet import read_columns
from graphrl_jax.perception.importers.recording import ImportFailure, in_order, read_text
from graphrl_jax.perception.importers.subtask_labels import SUBTASK_COLUMNS

VERSIONS = ("v2.1", "v3.0")
_PLACES = ("episode_index", "length", "data/chunk_index", "data/file_index", "dataset_from_index", "dataset_to_index")
_VIDEO_PLACES = ("chunk_index", "file_index", "from_timestamp", "to_timestamp")


@dataclass(frozen=True)
class Info:
    """What `meta/info.json` says.

    Attributes:
      path: that file.
      version: one of `VERSIONS`.
      frame_rate: frames per second.
      features: dtype, shape and names of each feature.
      num_episodes: number of episodes.
      num_frames: number of frames of all episodes.
      chunk_size: episodes in a folder, in v2.1.
      data_path: pattern of the data files' paths.
      video_path: pattern of the videos' paths, or None.
    """

    path: Path
    version: str
    frame_rate: float
    features: Mapping[str, Mapping[str, Any]]
    num_episodes: int
    num_frames: int
    chunk_size: int
    data_path: str
    video_path: str | None

    @property
    def folder(self) -> Path:
        """The folder of the dataset."""
        return self.path.parent.parent


@dataclass(frozen=True)
class Camera:
    """A camera: name of its feature, whether its frames are in videos, (height, width) of the frames."""

    key: str
    is_video: bool
    size: tuple[int, int]


@dataclass(frozen=True)
class Episode:
    """An episode.

    Attributes:
      index: its number, from 0.
      length: number of frames, T.
      first: number of its first frame in the dataset.
      data: file with its rows.
      clip: its frames in a video, or None if the pictures are in `data`.
      row: everything that the metadata say of it.
    """

    index: int
    length: int
    first: int
    data: Path
    clip: Clip | None
    row: Mapping[str, Any]


def read_info(path: Path) -> Info:
    """What `meta/info.json` says.

    Raises:
      ImportFailure: a field is missing or wrong, or the version is not among `VERSIONS`.
    """
    content = json_object(read_text(path), str(path))
    version = content.get("codebase_version")
    if version not in VERSIONS:
        raise ImportFailure(f"{path}: codebase_version is {version!r}; allowed: {', '.join(VERSIONS)}")
    features = content.get("features")
    if not isinstance(features, dict):
        raise ImportFailure(f"{path}: features is of type {type(features).__name__}; allowed: a JSON object")
    for name, feature in features.items():
        if not isinstance(feature, dict):
            raise ImportFailure(f"{path}: features: {name} is {feature!r}; allowed: its dtype, shape and names")
    for name, kinds in (("data_path", str), ("video_path", str | None)):
        if not isinstance(content.get(name), kinds):
            raise ImportFailure(f"{path}: {name} is {content.get(name)!r}; allowed: the pattern of a path")
    return Info(
        path=path,
        version=version,
        frame_rate=rate(content.get("fps"), f"{path}: fps"),
        features=features,
        num_episodes=whole(content.get("total_episodes"), f"{path}: total_episodes"),
        num_frames=whole(content.get("total_frames"), f"{path}: total_frames"),
        chunk_size=whole(content.get("chunks_size"), f"{path}: chunks_size", least=1),
        data_path=content["data_path"],
        video_path=content.get("video_path"),
    )


def camera_of(info: Info, asked: str | None) -> Camera:
    """The camera that was asked for, or the only one; cameras of depth do not count.

    Raises:
      ImportFailure: see `chosen_camera`; or its frames are not of three channels.
    """
    known = [name for name, feature in info.features.items() if _shows_colours(feature)]
    key = chosen_camera(info.folder, known, asked)
    feature = info.features[key]
    if feature["dtype"] == "video" and info.video_path is None:
        raise ImportFailure(f"{info.path}: video_path is missing, but {key} is a video; allowed: the pattern of a path")
    return Camera(key, feature["dtype"] == "video", _size(feature, f"{info.path}: {key}"))


def _shows_colours(feature: Mapping[str, Any]) -> bool:
    said = [about for about in (feature.get("info"), feature.get("video_info")) if isinstance(about, dict)]
    depth = any(about.get(name) for about in said for name in ("is_depth_map", "video.is_depth_map"))
    return feature.get("dtype") in ("video", "image") and not depth


def _size(feature: Mapping[str, Any], where: str) -> tuple[int, int]:
    """Height and width of a camera's frames; the order of its shape is that of its names."""
    shape, names = feature.get("shape"), feature.get("names")
    names = list(map(str, names)) if isinstance(names, list) else []
    if not {"height", "width"} <= set(names):
        names = ["height", "width", "channels"]
    if isinstance(shape, list) and len(shape) == len(names) == 3:
        sizes = dict(zip(names, shape, strict=True))
        height, width = (whole(sizes.pop(name), f"{where}: {name}", least=1) for name in ("height", "width"))
        if list(sizes.values()) == [3]:
            return height, width
    raise ImportFailure(f"{where}: shape is {shape!r}; allowed: height, width and 3 channels")


def read_episodes(info: Info, camera: Camera) -> list[Episode]:
    """The episodes, in order.

    Raises:
      ImportFailure: the metadata are damaged or lack a field, episodes are missing or listed twice, numbers of frames
        disagree, or a path leads out of the dataset.
    """
    rows = _rows_v21(info) if info.version == "v2.1" else _rows_v30(info, camera)
    rows = _in_order(rows, info)
    ends = [0, *accumulate(row["length"] for row in rows)]
    if ends[-1] != info.num_frames:
        raise ImportFailure(f"{info.path}: total_frames is {info.num_frames}; its episodes have {ends[-1]} frames")
    place = _place_v21 if info.version == "v2.1" else _place_v30
    return [place(info, camera, row, first) for row, first in zip(rows, ends[:-1], strict=True)]


def _in_order(rows: Sequence[dict[str, Any]], info: Info) -> list[dict[str, Any]]:
    """Rows sorted by their episodes, after a check that each episode is listed once."""
    by_index: dict[int, dict[str, Any]] = {}
    for row in rows:
        index = whole(row.get("episode_index"), f"{info.folder / 'meta'}: episode_index")
        whole(row.get("length"), f"{info.folder / 'meta'}: length of episode {index}", least=1)
        if index in by_index:
            raise ImportFailure(f"{info.folder / 'meta'}: episode {index} is listed twice; allowed: once")
        by_index[index] = row
    # Not a range of all episodes: their number is what the file says, however large.
    first_missing = next(index for index in range(len(by_index) + 1) if index not in by_index)
    missing = first_missing < info.num_episodes
    if missing or len(by_index) > info.num_episodes:
        which = f"episode {first_missing} is missing" if missing else f"{len(by_index)} episodes are listed"
        raise ImportFailure(f"{info.folder / 'meta'}: {which}, but total_episodes in info.json is {info.num_episodes}")
    return [by_index[index] for index in sorted(by_index)]


def _rows_v21(info: Info) -> list[dict[str, Any]]:
    path = info.folder / "meta" / "episodes.jsonl"
    lines = enumerate(read_text(path).splitlines(), start=1)
    return [json_object(line, f"{path}: line {number}") for number, line in lines if line.strip()]


def _place_v21(info: Info, camera: Camera, row: Mapping[str, Any], first: int) -> Episode:
    """An episode with a file of its own."""
    index, length = row["episode_index"], row["length"]
    numbers = {"episode_chunk": index // info.chunk_size, "episode_index": index}
    data = _filled(info, "data_path", numbers)
    clip = None
    if camera.is_video:
        clip = Clip(_filled(info, "video_path", {**numbers, "video_key": camera.key}), 0, length)
    return Episode(index, length, first, data, clip, row)


def _rows_v30(info: Info, camera: Camera) -> list[dict[str, Any]]:
    required = [*_PLACES, *(_video_field(camera, name) for name in _VIDEO_PLACES if camera.is_video)]
    rows = []
    for path in in_order((info.folder / "meta" / "episodes").glob("chunk-*/file-*.parquet")):
        columns = read_columns(path, required, SUBTASK_COLUMNS)
        rows += [dict(zip(columns, values, strict=True)) for values in zip(*columns.values(), strict=True)]
    return rows


def _video_field(camera: Camera, name: str) -> str:
    return f"videos/{camera.key}/{name}"


def _place_v30(info: Info, camera: Camera, row: Mapping[str, Any], first: int) -> Episode:
    """An episode in files that it shares with others."""
    index, length = row["episode_index"], row["length"]
    where = f"{info.folder / 'meta' / 'episodes'}: episode {index}"
    for name, expected in (("dataset_from_index", first), ("dataset_to_index", first + length)):
        if row[name] != expected:
            raise ImportFailure(
                f"{where}: {name} is {row[name]!r}; allowed: {expected}, by the lengths of the episodes"
            )
    data = _filled(info, "data_path", _numbers(row, "data", where))
    if not camera.is_video:
        return Episode(index, length, first, data, None, row)
    times = [row[_video_field(camera, name)] for name in ("from_timestamp", "to_timestamp")]
    if not all(isinstance(time, float | int) and time * info.frame_rate > -0.5 for time in times):
        raise ImportFailure(f"{where}: the times of {camera.key} are {times}; allowed: seconds from 0")
    begin, end = (time * info.frame_rate for time in times)
    if not abs(end - begin - length) < 0.5:
        raise ImportFailure(
            f"{where}: {camera.key} lasts {times[1] - times[0]:g} s; allowed: {length / info.frame_rate:g} s, its "
            f"{length} frames at {info.frame_rate:g} frames per second"
        )
    # Times are sums of durations and drift; rounded to whole frames they do not.
    video = {**_numbers(row, f"videos/{camera.key}", where), "video_key": camera.key}
    clip = Clip(_filled(info, "video_path", video), round(begin), round(begin) + length)
    return Episode(index, length, first, data, clip, row)


def _numbers(row: Mapping[str, Any], prefix: str, where: str) -> dict[str, int]:
    """The numbers of an episode's folder and file."""
    names = ("chunk_index", "file_index")
    return {name: whole(row[f"{prefix}/{name}"], f"{where}: {prefix}/{name}") for name in names}


def _filled(info: Info, field: str, values: Mapping[str, Any]) -> Path:
    """The path that a pattern such as `data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet` gives.

    Raises:
      ImportFailure: the pattern has an unknown field, or the path leads out of the dataset.
    """
    pattern = getattr(info, field)

    def value(found: re.Match[str]) -> str:
        known = found[1] in values and not (found[2] and isinstance(values[found[1]], str))
        return format(values[found[1]], found[2] or "") if known else found[0]

    filled = re.sub(r"\{(\w+)(?::(0\dd))?\}", value, pattern)
    if re.search("[{}]", filled):
        raise ImportFailure(f"{info.path}: {field} is {pattern!r}; allowed: the fields {', '.join(values)}")
    parts = PureWindowsPath(filled)  # knows the separators of all systems
    if parts.anchor or ".." in parts.parts:
        raise ImportFailure(f"{info.path}: {field} leads to {filled}; allowed: paths in the dataset's folder")
    return info.folder / filled
