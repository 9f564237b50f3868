"""What every source hands over, and the order of its files."""

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from graphrl_jax.detection import Detection


class ImportFailure(ValueError):
    """A source cannot be imported; the message names the file, and the line where there is one."""


@dataclass(frozen=True)
class Recording:
    """One demonstration as it was found.

    Attributes:
      source: where it came from.
      frames: (T, H, W, 3) uint8, or None where the source has boxes alone.
      detections: of every frame, or None where a detector has to look first.
      success: whether it reached the goal.
      frame_rate: frames per second, or None where the source does not say.
    """

    source: Path
    frames: np.ndarray | None = None
    detections: list[list[Detection]] | None = None
    success: bool = True
    frame_rate: float | None = None


Recordings = Iterator[Recording]
"""One at a time: a folder of videos need not fit into memory."""


def files_of(source: Path, *endings: str) -> list[Path]:
    """The source itself, or every file in it at any depth, whose name ends so; by the numbers in their names."""
    files = [source] if source.is_file() else [path for path in source.rglob("*") if path.is_file()]
    return in_order(path for path in files if path.name.lower().endswith(endings))


def folders_of(files: list[Path]) -> dict[Path, list[Path]]:
    """Files by the folder they lie in, in order."""
    folders: dict[Path, list[Path]] = {}
    for path in files:
        folders.setdefault(path.parent, []).append(path)
    return {folder: folders[folder] for folder in in_order(folders)}


def in_order(paths: Iterable[Path]) -> list[Path]:
    """Paths by the numbers in their names: 2 before 10."""
    return sorted(paths, key=lambda path: [(part.isdigit(), int(part) if part.isdigit() else 0, part)
                                           for part in re.split(r"(\d+)", str(path))])  # fmt: skip
