"""Scores of a recording under a reward model: a curve of progress, and what it says about the whole recording."""

from typing import Any, NamedTuple

import jax
import numpy as np

from graphrl_jax.encoder.pooling import PoolingParams
from graphrl_jax.graph import activity, safe_norm
from graphrl_jax.reward.alignment import value_order_correlation
from graphrl_jax.reward.card import Card
from graphrl_jax.reward.model import RewardModel
from graphrl_jax.reward.subtasks import rests

STALL_S, STALL_GAIN = 2.0, 0.02
"""A stall lasts at least so many seconds in which progress stays below the best so far plus this gain."""


class Curve(NamedTuple):
    """Scores of every frame of a recording.

    | field    | shape  | dtype   | meaning                                                    |
    |----------|--------|---------|------------------------------------------------------------|
    | distance | (T,)   | float32 | of the embedding to the goal's, without kappa              |
    | reward   | (T,)   | float32 | Eq. 3                                                      |
    | progress | (T,)   | float32 | 1 plus the reward, from 0 to 1                             |
    | subtask  | (T,)   | int64   | number of the subtask, from 0; 0 if only the robot moves   |
    | active   | (T, N) | bool    | objects that have moved                                    |
    | found    | (T, N) | bool    | objects that were seen                                     |
    | rest     | ()     | int     | frame from which on no object but the robot moves          |
    """

    distance: np.ndarray
    reward: np.ndarray
    progress: np.ndarray
    subtask: np.ndarray
    active: np.ndarray
    found: np.ndarray
    rest: int


def score(model: RewardModel, boxes: np.ndarray, mask: np.ndarray) -> Curve:
    """The curve of a recording.

    Args:
      model: a reward model of graphs, with a card.
      boxes: (T, N, 4) float32, in the order of the card's objects, at its frame rate.
      mask: (T, N) bool, False where an object was not seen.

    Raises:
      ValueError: see `RewardModel.embed_recording`.
    """
    boxes, mask = np.asarray(boxes, np.float32), np.asarray(mask, bool)
    embeddings = model.embed_recording(boxes, mask)
    distance = safe_norm(embeddings - model.goal[None])
    reward = np.asarray(model.value(distance))
    active, backwards = (
        np.asarray(_activity(*rows, model.pooling)) for rows in ((boxes, mask), (boxes[::-1], mask[::-1]))
    )
    objects = ~np.array(model.card.objects.is_robot)
    subtask = np.zeros(len(boxes), np.int64)
    if active[:, objects].any():
        for boundary in rests(np.asarray(embeddings), 1 / float(model.kappa)):
            subtask[boundary:] += 1
    # In backward order, an object is active as soon as it is away from its last place.
    moving = backwards[::-1, objects].any(axis=1)
    rest = int(np.flatnonzero(moving).max(initial=-1)) + 1
    return Curve(np.asarray(distance), reward, np.clip(1 + reward, 0, 1), subtask, active, mask, rest)


@jax.jit
def _activity(boxes: jax.Array, mask: jax.Array, pooling: PoolingParams) -> jax.Array:
    return activity(boxes, mask, pooling.tau, pooling.activity)


def at_times(curve: Curve, frame_rate: float, times: np.ndarray) -> Curve:
    """The curve at other times, such as those of the recording's own frames.

    Args:
      curve: a curve of T frames.
      frame_rate: its frames per second.
      times: (F,) seconds since the first frame.

    Returns:
      A curve of F frames: distance and reward are interpolated linearly, flags and subtasks are the nearest frame's.
    """
    own = np.arange(len(curve.reward)) / frame_rate
    nearest = np.round(times * frame_rate).astype(int).clip(0, len(own) - 1)
    distance, reward = (np.interp(times, own, values).astype(np.float32) for values in (curve.distance, curve.reward))
    return Curve(
        distance,
        reward,
        np.clip(1 + reward, 0, 1),
        curve.subtask[nearest],
        curve.active[nearest],
        curve.found[nearest],
        int(np.sum(times < curve.rest / frame_rate)),
    )


def summary(model: RewardModel, curve: Curve) -> dict[str, Any]:
    """What a curve says about its recording.

    Returns:
      frames, seconds; final_progress; value_order_correlation with time; rest, the time in seconds from which on no
      object but the robot moves; value_order_before_rest, the correlation up to it, since at rest there is no order;
      looks_like_success, whether the last reward is as high as at the ends of the demonstrations (`Card.end_reward`);
      stalls, from and to in seconds, none once a recording that ends as a success first looks so; subtasks, first
      frames of all but the first; coverage, the share of frames in which each object was seen, by name; unseen_at_end,
      objects that were seen, but not in the last frame, which makes the scores of the end doubtful.

    Raises:
      ValueError: the model has no card.
    """
    card = model.card
    if card is None:
        raise ValueError("a summary needs a reward model with a card")
    length = len(curve.reward)
    stalls = [(first / card.frame_rate, end / card.frame_rate) for first, end in _stalls(curve, card)]
    return {
        "frames": length,
        "seconds": length / card.frame_rate,
        "final_progress": float(curve.progress[-1]),
        "value_order_correlation": _order(curve.reward, length),
        "value_order_before_rest": _order(curve.reward, min(curve.rest + 1, length)),
        "rest": curve.rest / card.frame_rate,
        "looks_like_success": bool(curve.reward[-1] >= card.end_reward),
        "stalls": stalls,
        "subtasks": [int(frame) for frame in np.flatnonzero(np.diff(curve.subtask)) + 1],
        "coverage": dict(zip(card.objects.names, curve.found.mean(axis=0).round(4).tolist(), strict=True)),
        "unseen_at_end": [
            name for name, seen in zip(card.objects.names, curve.found.T, strict=True) if seen.any() and not seen[-1]
        ],
    }


def _order(reward: np.ndarray, length: int) -> float:
    """Correlation of the first `length` rewards with time."""
    return float(value_order_correlation(reward[None], np.array([length]))[0])


def _stalls(curve: Curve, card: Card) -> list[tuple[int, int]]:
    """First and end frames of the spans without a gain, before a recording that ends as a success first looks so."""
    like_success = curve.reward >= card.end_reward
    stop = int(np.argmax(like_success)) if like_success[-1] else len(like_success)
    best, since, found = -np.inf, 0, []
    for frame, progress in enumerate(curve.progress[:stop]):
        if progress > best + STALL_GAIN:
            found.append((since, frame))
            best, since = progress, frame
    found.append((since, stop))
    return [(first, end) for first, end in found if end - first >= STALL_S * card.frame_rate]
