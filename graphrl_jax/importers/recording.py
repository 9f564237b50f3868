"""What every source hands over."""

from collections.abc import Iterator
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
    """

    source: Path
    frames: np.ndarray | None = None
    detections: list[list[Detection]] | None = None
    success: bool = True


Recordings = Iterator[Recording]
"""One at a time: a folder of videos need not fit into memory."""
