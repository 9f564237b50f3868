"""Labels of subtasks in a LeRobotDataset, as its stage-aware reward model has them."""

from collections.abc import Mapping, Sequence
from typing import Any

from graphrl_jax.perception.importers.recording import ImportFailure

_PREFIXES = ("dense_", "sparse_", "")
"""Kinds of labels, the finest first; those without a prefix are older."""
_FIELDS = ("subtask_names", "subtask_start_frames", "subtask_end_frames")
SUBTASK_COLUMNS = tuple(prefix + field for prefix in _PREFIXES for field in _FIELDS)


def subtask_ends(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, int] | None]:
    """The frame at which each subtask ends, by name, for each episode.

    Args:
      rows: an episode's metadata each, with `episode_index`, `length` and, if labelled, lists of names, first and last
        frames of its subtasks. Of dense and sparse labels, the first kind counts that all episodes have.

    Returns:
      One mapping per episode, None for all if an episode has no labels. The second subtask of a name is "name 2".

    Raises:
      ImportFailure: lists of an episode differ in length, or a subtask is outside its episode.
    """
    for prefix in _PREFIXES:
        if rows and all(row.get(prefix + _FIELDS[0]) for row in rows):
            return [_ends(row, prefix) for row in rows]
    return [None] * len(rows)


def has_subtasks(row: Mapping[str, Any]) -> bool:
    """Whether an episode has labels of any kind."""
    return any(row.get(prefix + _FIELDS[0]) for prefix in _PREFIXES)


def _ends(row: Mapping[str, Any], prefix: str) -> dict[str, int]:
    where = f"meta/episodes: episode {row['episode_index']}"
    names, starts, stops = (row.get(prefix + field) for field in _FIELDS)
    lists = [values if isinstance(values, list) else [] for values in (names, starts, stops)]
    if len({len(values) for values in lists}) > 1:
        counts = ", ".join(f"{len(values)} {prefix}{field}" for values, field in zip(lists, _FIELDS, strict=True))
        raise ImportFailure(f"{where} has {counts}; allowed: as many of each")
    ends: dict[str, int] = {}
    for name, start, stop in zip(*lists, strict=True):
        if not all(isinstance(frame, int) for frame in (start, stop)) or not 0 <= start <= stop <= row["length"]:
            raise ImportFailure(
                f"{where}: subtask {name!r} is at frames {start!r} to {stop!r}; allowed: 0 to {row['length']}"
            )
        # A label that lasts to the end may end with the time after the last frame.
        ends[_unused(str(name), ends)] = min(stop, row["length"] - 1)
    return ends


def _unused(name: str, used: Mapping[str, int]) -> str:
    number = 1
    while (numbered := name if number == 1 else f"{name} {number}") in used:
        number += 1
    return numbered
