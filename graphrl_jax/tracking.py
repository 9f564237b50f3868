"""Who is who over time: detections of single frames, put into the node slots of an object table.

A detection fits a slot of its class, the nearer to where the slot's object was last seen the better; the assignment of
a frame is the cheapest over all slots (Hungarian). An object that is missed for a few frames is taken to go straight
from where it was lost to where it is found again; over longer gaps its slot is masked.
"""

from collections.abc import Iterable

import numpy as np
from scipy.optimize import linear_sum_assignment

from graphrl_jax.detection import Detection
from graphrl_jax.graph import ObjectTable

LONGEST_BRIDGE = 5
"""Frames over which a gap is bridged."""
FARTHEST = 0.15
"""How far an object may go in a frame, in units of the picture: a detection farther off opens a slot still empty."""
# Costs of a slot never filled, of one whose object was elsewhere, and of one of another class.
_FRESH, _ELSEWHERE, _NEVER = 2.0, 100.0, 1e6


def track(frames: Iterable[list[Detection]], objects: ObjectTable) -> tuple[np.ndarray, np.ndarray]:
    """Boxes (T, N, 4) float32 and mask (T, N) bool of a sequence of detections.

    Objects of one class that appear together first fill its slots from left to right. What finds no slot is dropped.
    """
    classes = np.array(objects.class_ids)
    last = np.full((objects.num_slots, 4), np.nan, np.float32)
    unseen = np.ones(objects.num_slots)
    rows = []
    for detections in frames:
        row = np.full_like(last, np.nan)
        if detections:
            boxes = np.stack([detection.box for detection in detections])
            found = np.array([detection.class_id for detection in detections])
            for slot, index in _assignment(boxes, found, last, FARTHEST * unseen, classes):
                row[slot] = last[slot] = boxes[index]
        unseen = np.where(np.isnan(row[:, 0]), unseen + 1, 1)
        rows.append(row)
    if not rows:
        return np.zeros((0, objects.num_slots, 4), np.float32), np.zeros((0, objects.num_slots), bool)
    return bridge(np.stack(rows))


def _assignment(
    boxes: np.ndarray, found: np.ndarray, last: np.ndarray, reach: np.ndarray, classes: np.ndarray
) -> list[tuple[int, int]]:
    """(slot, detection) pairs of least total cost, classes alike.

    Cheapest is the slot of an object that can have gone there, `reach` (N,) at most; then one never filled, from left
    to right; then one whose object was elsewhere.
    """
    distance = np.linalg.norm(last[:, None, :2] - boxes[None, :, :2], axis=-1)
    turn = np.array([np.sum((found == found[index]) & (boxes[:, 0] < boxes[index, 0])) for index in range(len(found))])
    order = _FRESH + np.abs(turn[None, :] - _rank(classes)[:, None])
    cost = np.where(np.isnan(distance), order, np.where(distance <= reach[:, None], distance, _ELSEWHERE + distance))
    cost = np.where(classes[:, None] == found[None, :], cost, _NEVER)
    pairs = zip(*linear_sum_assignment(cost), strict=True)
    return [(int(slot), int(index)) for slot, index in pairs if cost[slot, index] < _NEVER]


def _rank(classes: np.ndarray) -> np.ndarray:
    """How many earlier slots have the same class: (N,)."""
    return np.array([int(np.sum(classes[:slot] == classes[slot])) for slot in range(len(classes))])


def bridge(boxes: np.ndarray, longest: int = LONGEST_BRIDGE) -> tuple[np.ndarray, np.ndarray]:
    """Boxes (T, N, 4) with NaN where an object was not seen: short gaps are filled in, others become zeros, masked."""
    boxes = boxes.copy()
    for slot in range(boxes.shape[1]):
        seen = np.flatnonzero(~np.isnan(boxes[:, slot, 0]))
        for before, after in zip(seen[:-1], seen[1:], strict=True):
            if 1 < after - before <= longest + 1:
                share = np.arange(1, after - before)[:, None] / (after - before)
                boxes[before + 1 : after, slot] = boxes[before, slot] * (1 - share) + boxes[after, slot] * share
    mask = ~np.isnan(boxes[..., 0])
    return np.where(mask[..., None], boxes, 0.0).astype(np.float32), mask
