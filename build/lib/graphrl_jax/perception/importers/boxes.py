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


def turned_box(box: np.ndarray, pivot: Sequence[float], size: Sequence[float] | np.ndarray, where: str) -> np.ndarray:
    """The box around a turned box, in units of the image: (4,) float32.

    Args:
      box: (5,) x0, y0, w, h in pixels before the turn, and the turn in degrees, clockwise on the screen.
      pivot: what the box is turned about, in shares of its sides: (0, 0) is its top left corner, (0.5, 0.5) its centre.
      size: width and height of the image in pixels.
      where: place of the box, for messages.

    Raises:
      ImportFailure: a side is negative; see also `checked_box`.
    """
    corner, sides, turn = box[:2], box[2:4], np.deg2rad(box[4])
    if not (sides >= 0).all():
        raise ImportFailure(f"{where}: the box is {_shown(sides)} wide and high; allowed: sides of 0 or more")
    arms = (np.array([(0, 0), (1, 0), (1, 1), (0, 1)]) - pivot) * sides
    turned = arms @ np.array([(np.cos(turn), np.sin(turn)), (-np.sin(turn), np.cos(turn))])
    return box_of_points(((corner + pivot * sides + turned) / size).ravel(), where)


def image_size(own: Sequence[float] | None, asked: Sequence[float] | None, where: str) -> np.ndarray:
    """Width and height of images in pixels, as the file or the user says it: (2,) float.

    Args:
      own: what the file says.
      asked: what the user says.
      where: place of the size, for messages.

    Raises:
      ImportFailure: nobody says it, both say different sizes, or it is not above 0.
    """
    if own is not None and asked is not None and tuple(own) != tuple(asked):
        raise ImportFailure(f"{where}: the images are {_sides(own)}, but {_sides(asked)} by --size; leave it out")
    size = asked if own is None else own
    if size is None:
        raise ImportFailure(f"{where}: the size of the images is missing; --size says it")
    if not min(size) > 0:
        raise ImportFailure(f"{where}: the images are {_sides(size)}; allowed: sides above 0")
    return np.array(size, float)


def _sides(size: Sequence[float]) -> str:
    return f"{size[0]:g} x {size[1]:g}"


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
