"""Subtasks of a long task, found in the embeddings or rewards of an encoder, and their evaluation.

With the robot left out, an embedding rests while the robot is on its way to the next object and moves while the robot
moves an object. A subtask ends where the embedding comes to rest (`rests`). There are two general rules as well: change
points of the reward (`change_points`) and UVD's rule (`uvd`).

A boundary is the first frame of a new subtask. Frame 0 and the end of the episode are not boundaries.
"""

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
import ruptures
from scipy.ndimage import gaussian_filter1d
from scipy.optimize import linear_sum_assignment

from graphrl_jax.demonstrations import Demonstrations
from graphrl_jax.reward.config import SUBTASK_METHODS, SubtaskMethod
from graphrl_jax.reward.model import RewardModel, demonstration_embeddings, demonstration_rewards

TOLERANCES = (0.01, 0.02, 0.05)
"""Tolerances of a boundary's position, as shares of the episode."""
# Least length of a subtask, as a share of the episode.
SHORTEST = 0.04
# A rest lasts at least the share REST of an episode, and moves at most the share STILL of the way from start to goal.
REST, STILL = 0.06, 0.01
# It may also move by this many standard deviations of the embedding's noise.
_NOISE = 4.0
# Cost of a boundary, in units of noise variance times shortest length of a subtask times logarithm of the length.
PENALTY = 40.0
# Standard deviation of UVD's smoothing, as a share of the episode.
_SMOOTHING = 0.01


def rests(embeddings: np.ndarray, distance: float, shortest: float = REST, still: float = STILL) -> list[int]:
    """First frame of every rest of the embedding, except a rest at the beginning.

    A rest is a longest run of windows of length `shortest` in which no embedding is further than `still` from the
    window's first. The rule is independent of the task; its constants were set on training demonstrations of Shoes in
    Box.

    Args:
      embeddings: (T, D).
      distance: distance between the embeddings of start and goal; 1 / kappa of a reward.
      shortest: length of a window, as a share of the episode.
      still: largest movement in a window, as a share of `distance`.
    """
    frames = len(embeddings)
    window = max(2, round(shortest * frames))
    if frames < 2 * window:
        return []
    scaled = np.asarray(embeddings, float) / distance
    # Second differences cancel steady motion; those of noise are sqrt(6) times the noise.
    noise = np.median(np.linalg.norm(np.diff(scaled, n=2, axis=0), axis=1)) / np.sqrt(6)
    windows = np.lib.stride_tricks.sliding_window_view(scaled, window, axis=0)
    spread = np.linalg.norm(windows - windows[..., :1], axis=1).max(1)
    resting = np.zeros(frames, bool)
    for frame in np.flatnonzero(spread <= max(still, _NOISE * noise)):
        resting[frame : frame + window] = True
    return [int(frame) for frame in np.flatnonzero(resting[1:] & ~resting[:-1]) + 1]


def change_points(profile: np.ndarray, penalty: float = PENALTY, shortest: float = SHORTEST) -> list[int]:
    """Boundaries of a step-like profile (T,): the best piecewise constant fit, with a cost `penalty` per step.

    The number of steps follows from the noise, which is estimated from differences of neighbouring frames (PELT,
    Killick et al. 2012, by `ruptures`).
    """
    frames = len(profile)
    size = max(2, round(shortest * frames))
    if frames < 2 * size:
        return []
    differences = np.diff(profile)
    noise = max(np.median(np.abs(differences)) / 0.6745, 1e-3 * float(np.ptp(profile)), 1e-9) ** 2 / 2
    found = ruptures.Pelt(model="l2", min_size=size, jump=1).fit(np.asarray(profile, float)[:, None])
    # Frames are far from independent, so `size` frames count as one.
    return [int(end) for end in found.predict(penalty * noise * size * np.log(frames))[:-1]]


def uvd(embeddings: np.ndarray, shortest: float = SHORTEST) -> list[int]:
    """Boundaries by the rule of UVD (Zhang et al. 2024), backwards from the end, on embeddings (T, D).

    Within a subtask the distance to its last frame falls. Going back in time, the subtask begins where this distance
    stops rising, and that frame is the end of the previous subtask.
    """
    frames = len(embeddings)
    least, end, boundaries = max(2, round(shortest * frames)), frames - 1, []
    while end > least:
        distance = np.linalg.norm(embeddings[: end + 1] - embeddings[end], axis=1)
        distance = gaussian_filter1d(distance, max(_SMOOTHING * frames, 0.5), mode="nearest")
        earlier = np.arange(1, end - least + 1)
        peaks = earlier[(distance[earlier] >= distance[earlier - 1]) & (distance[earlier] > distance[earlier + 1])]
        if not len(peaks) or peaks[-1] < least:
            break
        end = int(peaks[-1])
        boundaries.append(end)
    return boundaries[::-1]


def true_boundaries(events: np.ndarray, length: int) -> list[int]:
    """Frames of the events (E,) inside an episode, sorted, without duplicates."""
    return sorted({int(frame) for frame in events if 0 < frame < length})


def boundary_f1(found: Sequence[int], true: Sequence[int], length: int, tolerance: float) -> float:
    """F1 of boundaries within `tolerance` (a share of the length), matched one to one; 1 if both lists are empty."""
    if not found and not true:
        return 1.0
    if not found or not true:
        return 0.0
    close = np.abs(np.subtract.outer(found, true)) <= tolerance * length
    matched = close[linear_sum_assignment(~close)].sum()
    return float(2 * matched / (len(found) + len(true)))


def covering(found: Sequence[int], true: Sequence[int], length: int) -> float:
    """Covering of true subtasks by found ones: the best overlap (intersection over union), weighted by length."""

    def spans(boundaries: Sequence[int]) -> list[tuple[int, int]]:
        ends = [0, *boundaries, length]
        return [(a, b) for a, b in zip(ends[:-1], ends[1:], strict=True) if b > a]

    def overlap(one: tuple[int, int], other: tuple[int, int]) -> float:
        common = max(0, min(one[1], other[1]) - max(one[0], other[0]))
        return common / (one[1] - one[0] + other[1] - other[0] - common)

    best = ((b - a, max(overlap((a, b), span) for span in spans(found))) for a, b in spans(true))
    return sum(weight * share for weight, share in best) / length


def judge(found: Sequence[Sequence[int]], true: Sequence[Sequence[int]], lengths: np.ndarray) -> dict[str, Any]:
    """Means over episodes: F1 at every tolerance, covering, and the numbers of found and true boundaries."""
    episodes = list(zip(found, true, [int(length) for length in lengths], strict=True))
    return {
        **{
            f"f1_at_{tolerance:.0%}": float(np.mean([boundary_f1(*episode, tolerance) for episode in episodes]))
            for tolerance in TOLERANCES
        },
        "covering": float(np.mean([covering(*episode) for episode in episodes])),
        "found": float(np.mean([len(boundaries) for boundaries, _, _ in episodes])),
        "true": float(np.mean([len(boundaries) for _, boundaries, _ in episodes])),
    }


def demonstration_subtasks(model: RewardModel, demonstrations: Demonstrations, method: SubtaskMethod) -> dict[str, Any]:
    """Subtask boundaries of every demonstration, judged against the true events if there are any.

    Args:
      model: the reward.
      demonstrations: demonstrations of any kind, with or without events.
      method: rule that finds the boundaries.

    Returns:
      subtasks: per demonstration its length, its kind, and its boundaries in frames and in seconds.
      judged: see `judge`; only with events.

    Raises:
      ValueError: the method is unknown.
    """
    rows, found = [], _boundaries(model, demonstrations, method)
    lengths = [int(length) for length in demonstrations.lengths]
    kinds = demonstrations.kinds
    for index, (boundaries, length) in enumerate(zip(found, lengths, strict=True)):
        seconds = [frame / demonstrations.frame_rate for frame in boundaries]
        kind = None if kinds is None else str(kinds[index])
        rows.append({"length": length, "kind": kind, "boundaries": boundaries, "seconds": seconds})
    if demonstrations.events is None:
        return {"subtasks": rows}
    true = [true_boundaries(*pair) for pair in zip(demonstrations.events, lengths, strict=True)]
    return {"subtasks": rows, "judged": judge(found, true, demonstrations.lengths)}


def _boundaries(model: RewardModel, demonstrations: Demonstrations, method: SubtaskMethod) -> list[list[int]]:
    """Boundaries of every demonstration."""
    if method not in SUBTASK_METHODS:
        raise ValueError(f"unknown method {method!r}; known methods: {', '.join(SUBTASK_METHODS)}")
    if method == "change_points":
        profiles, find = demonstration_rewards(model, demonstrations), change_points
    else:
        profiles = demonstration_embeddings(model, demonstrations)
        find = uvd if method == "uvd" else partial(rests, distance=1 / float(model.kappa))
    rows = zip(np.asarray(profiles), demonstrations.lengths, strict=True)
    return [find(profile[:length]) for profile, length in rows]
