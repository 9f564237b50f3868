"""Tracks that are given by key frames, and detections by frame."""

from collections.abc import Iterable, Sequence
from itertools import zip_longest
from typing import NamedTuple

import numpy as np

from graphrl_jax.perception.detector import Detection
from graphrl_jax.perception.importers.recording import MOST_FRAMES, ImportFailure
from graphrl_jax.perception.importers.values import whole


class KeyFrame(NamedTuple):
    """A box that somebody drew.

    Attributes:
      frame: number of the frame, from 0.
      box: (5,) x0, y0, w, h in any unit, and the turn in degrees.
      seen: whether the object is there in this frame.
      lasts: whether it is there in the frames up to the next key frame, or to the end.
      where: its place, for messages.
    """

    frame: int
    box: np.ndarray
    seen: bool
    lasts: bool
    where: str


def track_boxes(keys: Iterable[KeyFrame], length: int) -> dict[int, np.ndarray]:
    """The box (5,) of a track in each frame in which its object is there.

    Between key frames the box changes linearly and turns the shorter way; after the last one it stays as it is.

    Args:
      keys: key frames in any order, below `length`.
      length: number of frames.

    Raises:
      ImportFailure: two key frames are of one frame.
    """
    found: dict[int, np.ndarray] = {}
    ordered = sorted(keys, key=lambda key: key.frame)
    for key, after in zip_longest(ordered, ordered[1:]):
        if after is not None and after.frame == key.frame:
            raise ImportFailure(f"{after.where}: the track has two boxes in this frame; allowed: one")
        if key.seen:
            found[key.frame] = key.box
        if key.lasts:
            end = length if after is None else after.frame
            step = np.zeros(5) if after is None else _change(key.box, after.box) / (end - key.frame)
            found |= {frame: key.box + step * (frame - key.frame) for frame in range(key.frame + 1, end)}
    return found


def _change(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """What changes from one box (5,) to another, by the shorter turn: (5,)."""
    change = after - before
    change[4] = (change[4] + 180) % 360 - 180
    return change


def checked_length(value: float, what: str) -> int:
    """A number of frames.

    Raises:
      ImportFailure: it is not whole, or not from 1 to `MOST_FRAMES`.
    """
    return whole(value, what, 1, MOST_FRAMES)


def by_frame(found: Sequence[tuple[int, Detection]], length: int) -> list[list[Detection]]:
    """Detections in every frame, from those with the numbers of their frames."""
    frames: list[list[Detection]] = [[] for _ in range(length)]
    for frame, detection in found:
        frames[frame].append(detection)
    return frames
