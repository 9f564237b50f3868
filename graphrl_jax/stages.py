"""Stages of a long task, found in what an encoder makes of it, and how to judge them.

With the robot left out, an embedding rests while the robot is on its way to the next object and moves while it moves
one. A stage ends where the embedding comes to rest (`rests`). Beside it stand two general rules: change points of the
reward (`change_points`) and UVD's rule (`uvd`).

A boundary is the first frame of a new stage. Frame 0 and the end of the episode are no boundaries.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import ruptures
from scipy.ndimage import gaussian_filter1d
from scipy.optimize import linear_sum_assignment

TOLERANCES = (0.01, 0.02, 0.05)
"""Shares of an episode by which a boundary may be off."""
# Stages last at least this share of an episode.
SHORTEST = 0.04
# A rest lasts at least this share of an episode, and moves at most by this share of the way from start to goal.
REST, STILL = 0.06, 0.01
# Or by as many deviations of the embedding's noise, should there be any.
_NOISE = 4.0
# Cost of a further boundary, in variances of the profile's noise times the logarithm of the length.
PENALTY = 40.0
# UVD's smoothing, a share of the episode.
_SMOOTHING = 0.01


def rests(embeddings: np.ndarray, distance: float, shortest: float = REST, still: float = STILL) -> list[int]:
    """Where the embedding comes to rest: the first frame of every rest but one at the beginning.

    A rest is a longest stretch of windows of `shortest` within which no embedding is further from the first than
    `still`. Neither rule nor numbers know of a task; the latter were set on training demonstrations of Shoes in Box.

    Args:
      embeddings: (T, D).
      distance: between the embeddings of start and goal, the unit of `still`; 1 / kappa of a reward.
      shortest: share of the episode.
      still: share of the distance.
    """
    frames = len(embeddings)
    window = max(2, round(shortest * frames))
    if frames < 2 * window:
        return []
    scaled = np.asarray(embeddings, float) / distance
    # Second differences know nothing of steady motion; those of noise are the root of six times the noise.
    noise = np.median(np.linalg.norm(np.diff(scaled, n=2, axis=0), axis=1)) / np.sqrt(6)
    windows = np.lib.stride_tricks.sliding_window_view(scaled, window, axis=0)
    spread = np.linalg.norm(windows - windows[..., :1], axis=1).max(1)
    resting = np.zeros(frames, bool)
    for frame in np.flatnonzero(spread <= max(still, _NOISE * noise)):
        resting[frame : frame + window] = True
    return [int(frame) for frame in np.flatnonzero(resting[1:] & ~resting[:-1]) + 1]


def change_points(profile: np.ndarray, penalty: float = PENALTY, shortest: float = SHORTEST) -> list[int]:
    """Boundaries of a step-like profile (T,): the best piecewise constant fit, a further step costing `penalty`.

    The number of steps is not given but follows from the noise, estimated from differences of neighbours (PELT,
    Killick et al. 2012, by `ruptures`).
    """
    frames = len(profile)
    size = max(2, round(shortest * frames))
    if frames < 2 * size:
        return []
    differences = np.diff(profile)
    noise = max(np.median(np.abs(differences)) / 0.6745, 1e-3 * float(np.ptp(profile)), 1e-9) ** 2 / 2
    found = ruptures.Pelt(model="l2", min_size=size, jump=1).fit(np.asarray(profile, float)[:, None])
    # Frames are far from independent: a stage of `size` frames counts as one.
    return [int(end) for end in found.predict(penalty * noise * size * np.log(frames))[:-1]]


def uvd(embeddings: np.ndarray, shortest: float = SHORTEST) -> list[int]:
    """Boundaries by the rule of UVD (Zhang et al. 2024), backwards from the end, on embeddings (T, D).

    The distance to a stage's last frame falls while the stage lasts; where, going back in time, it stops rising, the
    stage begins, and the frame there ends the stage before.
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
    """Frames of the events (E,) that happened inside an episode, each once, in order."""
    return sorted({int(frame) for frame in events if 0 < frame < length})


def boundary_f1(found: Sequence[int], true: Sequence[int], length: int, tolerance: float) -> float:
    """F1 of boundaries within `tolerance` (a share of the length), matched one to one; 1 if there are none at all."""
    if not found and not true:
        return 1.0
    if not found or not true:
        return 0.0
    close = np.abs(np.subtract.outer(found, true)) <= tolerance * length
    matched = close[linear_sum_assignment(~close)].sum()
    return float(2 * matched / (len(found) + len(true)))


def covering(found: Sequence[int], true: Sequence[int], length: int) -> float:
    """How well found stages cover the true ones: their best overlap (intersection over union), weighed by length."""

    def stages(boundaries: Sequence[int]) -> list[tuple[int, int]]:
        ends = [0, *boundaries, length]
        return [(a, b) for a, b in zip(ends[:-1], ends[1:], strict=True) if b > a]

    def overlap(one: tuple[int, int], other: tuple[int, int]) -> float:
        common = max(0, min(one[1], other[1]) - max(one[0], other[0]))
        return common / (one[1] - one[0] + other[1] - other[0] - common)

    best = ((b - a, max(overlap((a, b), stage) for stage in stages(found))) for a, b in stages(true))
    return sum(weight * share for weight, share in best) / length


def judge(found: Sequence[Sequence[int]], true: Sequence[Sequence[int]], lengths: np.ndarray) -> dict[str, Any]:
    """Means over episodes: F1 at every tolerance, covering, and boundaries found and true per episode."""
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
