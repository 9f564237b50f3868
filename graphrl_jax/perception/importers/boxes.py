"""Boxes of ready-made labels, checked."""

from collections.abc import Sequence

import numpy as np

from graphrl_jax.demonstrations import BOX_RANGE
from graphrl_jax.perception.detector import box_of_corners
from graphrl_jax.perception.importers.recording import ImportFailure


def checked_box(box: np.ndarray, where: str) -> np.ndarray:
    """A box (cx, cy, w, h) in units of the image: (4,) float32.

    Raises:
      ImportFailure: a number is not finite, a side is negative, or an edge is far outside the image.
    """
    low, high = BOX_RANGE
    if not np.isfinite(box).all() or (box[2:] < 0).any() or (np.abs(box[:2] - 0.5) + box[2:] / 2 > high - 0.5).any():
        raise ImportFailure(
            f"{where}: the box (cx, cy, w, h) is {_shown(box)}; allowed: edges from {low} to {high}, in units of the "
            "image, and sides of 0 or more"
        )
    return box.astype(np.float32)


def box_of_points(points: Sequence[float], where: str) -> np.ndarray:
    """The box around points x0, y0, x1, y1, ... in units of the image: (4,) float32.

    Raises:
      ImportFailure: see `checked_box`.
    """
    corners = np.array(points, float).reshape(-1, 2)
    return checked_box(box_of_corners(np.concatenate([corners.min(0), corners.max(0)])), where)


def checked_confidence(value: float, what: str) -> float:
    """A confidence.

    Raises:
      ImportFailure: it is not in 0 to 1.
    """
    if not 0 <= value <= 1:
        raise ImportFailure(f"{what} is {value:g}; allowed: a confidence from 0 to 1")
    return value


def _shown(values: np.ndarray) -> str:
    return ", ".join(f"{value:.4g}" for value in values)
