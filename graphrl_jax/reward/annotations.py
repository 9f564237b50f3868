"""Subtasks of scored recordings, as LeRobot's stage-aware reward model has them in the metadata of a dataset.

subtasks.parquet                    a row per episode, with the columns that belong into meta/episodes
temporal_proportions_sparse.json    the mean share of each subtask, as in meta/
"""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyarrow as pa
from pyarrow import parquet

from graphrl_jax.storage import write_atomically, write_json

SUBTASKS, PROPORTIONS = "subtasks.parquet", "temporal_proportions_sparse.json"
_SCHEMA = pa.schema(
    {
        "episode_index": pa.int64(),
        "sparse_subtask_names": pa.list_(pa.string()),
        "sparse_subtask_start_times": pa.list_(pa.float64()),
        "sparse_subtask_end_times": pa.list_(pa.float64()),
        "sparse_subtask_start_frames": pa.list_(pa.int64()),
        "sparse_subtask_end_frames": pa.list_(pa.int64()),
    }
)


class Subtasks(NamedTuple):
    """The K subtasks of an episode, in its own frames.

    | field      | shape | dtype | meaning                     |
    |------------|-------|-------|-----------------------------|
    | first      | (K,)  | int   | first frame of each         |
    | last       | (K,)  | int   | last frame of each          |
    | frame_rate |       | float | frames per second           |
    """

    first: np.ndarray
    last: np.ndarray
    frame_rate: float


def subtasks_of(numbers: np.ndarray, shown: np.ndarray, length: int, frame_rate: float) -> Subtasks:
    """The subtasks of an episode whose frames were resampled to be scored.

    Args:
      numbers: (T,) int, number of the subtask in each frame that was scored, such as `Curve.subtask`.
      shown: (T,) int, number of the episode's own frame that each of them is.
      length: number of the episode's own frames.
      frame_rate: own frames per second.

    Returns:
      Its subtasks; one that lies between two of its own frames is left out.
    """
    boundaries = np.flatnonzero(np.diff(numbers)) + 1
    first = np.unique([0, *shown[boundaries]])
    return Subtasks(first, np.append(first[1:] - 1, length - 1), frame_rate)


def write_subtasks(folder: Path, episodes: Sequence[Subtasks]) -> None:
    """Writes the files of the module's docstring; `episode_index` is the number in `episodes`.

    The subtasks are called subtask_1, subtask_2, ... in each episode. Times are those of the frames, from the episode's
    start.
    """
    rows = [_row(index, episode) for index, episode in enumerate(episodes)]
    write_table(folder / SUBTASKS, pa.Table.from_pylist(rows, _SCHEMA))
    write_json(folder / PROPORTIONS, proportions(episodes))


def proportions(episodes: Sequence[Subtasks]) -> dict[str, float]:
    """Mean share of each subtask in the episodes, by name and in order; 0 in an episode without it. They sum to 1."""
    most = max(len(episode.first) for episode in episodes)
    lengths = [np.pad(episode.last - episode.first + 1, (0, most - len(episode.first))) for episode in episodes]
    shares = np.mean([length / length.sum() for length in lengths], axis=0)
    return dict(zip(_names(most), map(float, shares), strict=True))


def write_table(path: Path, table: pa.Table) -> None:
    """Writes a table as a parquet file, atomically."""
    write_atomically(path, lambda temporary: parquet.write_table(table, temporary))


def _row(index: int, episode: Subtasks) -> dict[str, object]:
    first, last, frame_rate = episode
    return {
        "episode_index": index,
        "sparse_subtask_names": _names(len(first)),
        "sparse_subtask_start_times": (first / frame_rate).tolist(),
        "sparse_subtask_end_times": (last / frame_rate).tolist(),
        "sparse_subtask_start_frames": first.tolist(),
        "sparse_subtask_end_frames": last.tolist(),
    }


def _names(number: int) -> list[str]:
    return [f"subtask_{index + 1}" for index in range(number)]
