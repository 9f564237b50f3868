"""The interface of a detector: it finds the classes and boxes of objects in one frame.

`tracking` assigns identities over time.
"""

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np


class Detection(NamedTuple):
    """An object in a frame.

    Attributes:
      class_id: its class.
      box: (4,) float32, cx, cy, w, h in units of the frame.
      confidence: from 0 to 1; ranks the detections of a class if they are more than its slots.
    """

    class_id: int
    box: np.ndarray
    confidence: float = 1.0


class Detector(Protocol):
    """Anything that finds objects in a frame."""

    def detect(self, frame: np.ndarray) -> list[Detection]:
        """Objects in a frame (H, W, 3) uint8, in any order."""
        ...


@dataclass(frozen=True)
class NoDetector:
    """Stands where no detector is known: it refuses images.

    Attributes:
      why: one sentence, which says what would find the objects.
    """

    why: str

    def detect(self, frame: np.ndarray) -> list[Detection]:
        """Finds nothing.

        Raises:
          ValueError: always; the message is `why`.
        """
        raise ValueError(self.why)


def box_of_corners(corners: np.ndarray) -> np.ndarray:
    """Box cx, cy, w, h of corners x0, y0, x1, y1: (4,) float32."""
    low, high = corners[:2], corners[2:]
    return np.concatenate([(low + high) / 2, high - low]).astype(np.float32)
