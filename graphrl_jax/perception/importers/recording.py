"""Recordings, the output of all readers, and the order of files."""

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from fnmatch import fnmatch
from pathlib import Path

import numpy as np

from graphrl_jax.perception.detector import Detection


class ImportFailure(ValueError):
    """A source cannot be imported; the message names the file, and the line where there is one."""


@dataclass(frozen=True)
class Recording:
    """One demonstration as read from its source.

    Attributes:
      source: file or folder of the recording.
      frames: (T, H, W, 3) uint8, or None if the source has only boxes.
      detections: detections in every frame, or None if a detector has to find them.
      success: whether it reached the goal.
      frame_rate: frames per second, or None if the source does not contain it.
    """

    source: Path
    frames: np.ndarray | None = None
    detections: list[list[Detection]] | None = None
    success: bool = True
    frame_rate: float | None = None


Recordings = Iterator[Recording]
"""Recordings one at a time, so that a folder of videos need not fit into memory."""


def files_of(source: Path, *endings: str) -> list[Path]:
    """Files with one of these endings, the source or files in it at any depth; sorted by the numbers in their names."""
    files = [source] if source.is_file() else [path for path in source.rglob("*") if path.is_file()]
    return in_order(path for path in files if any(fnmatch(path.name.lower(), f"*{ending}") for ending in endings))


def folders_of(files: list[Path]) -> dict[Path, list[Path]]:
    """Files by folder; folders are sorted by the numbers in their names."""
    folders: dict[Path, list[Path]] = {}
    for path in files:
        folders.setdefault(path.parent, []).append(path)
    return {folder: folders[folder] for folder in in_order(folders)}


def in_order(paths: Iterable[Path]) -> list[Path]:
    """Paths sorted by the numbers in their names: 2 before 10."""
    return sorted(paths, key=lambda path: [(part.isdigit(), int(part) if part.isdigit() else 0, part)
                                           for part in re.split(r"(\d+)", str(path))])  # fmt: skip
