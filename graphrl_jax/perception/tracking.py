"""Tracking: assigns the detections of single frames to the node slots of an object table.

A detection is assigned to a slot of its class. The cost is the distance from the last position of the slot's object,
and a frame takes the cheapest assignment over all slots (Hungarian). Boxes of an object that is missed for a few frames
are interpolated linearly; over longer gaps its slot is masked.
"""

from collections.abc import Iterable

import numpy as np
from scipy.optimize import linear_sum_assignment

from graphrl_jax.graph import ObjectTable
from graphrl_jax.perception.detector import Detection

LONGEST_BRIDGE = 5
"""Longest gap that is bridged, in frames."""
FARTHEST = 0.15
"""Largest movement of an object per frame, in units of the image; a farther detection takes an empty slot first."""
# Costs of a slot that was never filled, of a slot with an object too far away, and of a slot of another class.
_FRESH, _ELSEWHERE, _NEVER = 2.0, 100.0, 1e6


def track(frames: Iterable[list[Detection]], objects: ObjectTable) -> tuple[np.ndarray, np.ndarray]:
    """Boxes (T, N, 4) float32 and mask (T, N) bool of a sequence of detections: `assign`, then `bridge`."""
    return bridge(assign(frames, objects))


class Tracker:
    """Assigns the detections of one frame after the other; see `assign`."""

    def __init__(self, objects: ObjectTable):
        self._classes = np.array(objects.class_ids)
        self._last = np.full((objects.num_slots, 4), np.nan, np.float32)
        self._unseen = np.ones(objects.num_slots)

    def see(self, detections: list[Detection]) -> np.ndarray:
        """Boxes (N, 4) float32 of the next frame, NaN where an object was not seen."""
        row = np.full_like(self._last, np.nan)
        detections = _most_confident(detections, self._classes)
        if detections:
            boxes = np.stack([detection.box for detection in detections])
            found = np.array([detection.class_id for detection in detections])
            for slot, index in _assignment(boxes, found, self._last, FARTHEST * self._unseen, self._classes):
                row[slot] = self._last[slot] = boxes[index]
        self._unseen = np.where(np.isnan(row[:, 0]), self._unseen + 1, 1)
        return row

    def held(self, longest: int = LONGEST_BRIDGE) -> tuple[np.ndarray, np.ndarray]:
        """Boxes (N, 4) float32 and mask (N,) bool as of the last frame.

        An object that has been missed for up to `longest` frames keeps its last box; others are zeros and masked.
        `bridge` does better, but it needs the frames after a gap.
        """
        mask = ~np.isnan(self._last[:, 0]) & (self._unseen <= longest + 1)
        return np.where(mask[:, None], self._last, 0.0).astype(np.float32), mask


def assign(frames: Iterable[list[Detection]], objects: ObjectTable) -> np.ndarray:
    """Boxes (T, N, 4) float32 of a sequence of detections, NaN where an object was not seen.

    Objects of one class that first appear together fill its slots from left to right. Of more detections than a class
    has slots, the most confident ones are tracked. A detection without a slot is dropped.
    """
    tracker = Tracker(objects)
    none = np.zeros((0, objects.num_slots, 4), np.float32)
    return np.concatenate([none, *(tracker.see(detections)[None] for detections in frames)])


def _most_confident(detections: list[Detection], classes: np.ndarray) -> list[Detection]:
    """As many detections of each class as it has slots (N,), and those as confident as the last one of them."""
    kept = []
    for class_id in dict.fromkeys(detection.class_id for detection in detections):
        # Of a box that is listed twice, one counts.
        same = {detection.box.tobytes(): detection for detection in detections if detection.class_id == class_id}
        slots = int(np.sum(classes == class_id))
        ranked = sorted((detection.confidence for detection in same.values()), reverse=True)
        least = ranked[min(slots, len(ranked)) - 1] if slots else np.inf
        kept += [detection for detection in same.values() if detection.confidence >= least]
    return kept


def _assignment(
    boxes: np.ndarray, found: np.ndarray, last: np.ndarray, reach: np.ndarray, classes: np.ndarray
) -> list[tuple[int, int]]:
    """(slot, detection) pairs of the same class with the least total cost.

    The cheapest slot has an object within `reach` (N,) of the detection. Next are slots that were never filled, from
    left to right, then slots with an object farther away.
    """
    distance = np.linalg.norm(last[:, None, :2] - boxes[None, :, :2], axis=-1)
    turn = np.array([np.sum((found == found[index]) & (boxes[:, 0] < boxes[index, 0])) for index in range(len(found))])
    order = _FRESH + np.abs(turn[None, :] - _rank(classes)[:, None])
    cost = np.where(np.isnan(distance), order, np.where(distance <= reach[:, None], distance, _ELSEWHERE + distance))
    cost = np.where(classes[:, None] == found[None, :], cost, _NEVER)
    pairs = zip(*linear_sum_assignment(cost), strict=True)
    return [(int(slot), int(index)) for slot, index in pairs if cost[slot, index] < _NEVER]


def _rank(classes: np.ndarray) -> np.ndarray:
    """Number of earlier slots with the same class: (N,)."""
    return np.array([int(np.sum(classes[:slot] == classes[slot])) for slot in range(len(classes))])


def bridge(boxes: np.ndarray, longest: int = LONGEST_BRIDGE) -> tuple[np.ndarray, np.ndarray]:
    """Fills short gaps in boxes (T, N, 4), NaN where an object was not seen; longer gaps become zeros and masked."""
    boxes = boxes.copy()
    for slot in range(boxes.shape[1]):
        seen = np.flatnonzero(~np.isnan(boxes[:, slot, 0]))
        for before, after in zip(seen[:-1], seen[1:], strict=True):
            if 1 < after - before <= longest + 1:
                share = np.arange(1, after - before)[:, None] / (after - before)
                boxes[before + 1 : after, slot] = boxes[before, slot] * (1 - share) + boxes[after, slot] * share
    mask = ~np.isnan(boxes[..., 0])
    return np.where(mask[..., None], boxes, 0.0).astype(np.float32), mask
