"""Statistics of a few runs (Agarwal et al. 2021): interquartile means, probability of improvement, profiles of scores.

Runs are grouped by ground, such as a layout of a task. Intervals are percentile bootstraps, stratified by ground: each
resample draws as many runs of a ground as there are. Of few runs they are too narrow, because what no run shows cannot
be drawn.
"""

from collections.abc import Callable, Sequence

import numpy as np
from scipy.stats import bootstrap, trim_mean

RESAMPLES = 5000
CONFIDENCE = 0.95
_SEED = 0
Grounds = Sequence[Sequence[float]]
"""A value per run, by ground."""


def interquartile_mean(values: np.ndarray, axis: int = -1) -> np.ndarray:
    """Mean without the lowest and the highest quarter of the values, rounded down to whole values."""
    return trim_mean(values, 0.25, axis=axis)


def interval(grounds: Grounds, statistic: Callable[..., np.ndarray]) -> list[float] | None:
    """Bootstrap interval of a statistic of runs, at `CONFIDENCE`; None where a ground has fewer than two runs.

    Args:
      grounds: of the statistic.
      statistic: takes an array per ground, and the axis that holds the runs; it may have leading axes of resamples.
    """
    samples = tuple(np.asarray(runs, float) for runs in grounds)
    if min(map(len, samples)) < 2:
        return None
    found = bootstrap(
        samples, statistic, n_resamples=RESAMPLES, confidence_level=CONFIDENCE, method="percentile", vectorized=True,
        rng=np.random.default_rng(_SEED),
    ).confidence_interval  # fmt: skip
    return [float(found.low), float(found.high)]


def interquartile_mean_of(grounds: Grounds) -> dict[str, float | list[float] | None]:
    """Interquartile mean over all runs of all grounds, `mean`, and its interval, `interval_95`."""

    def together(*runs: np.ndarray, axis: int = -1) -> np.ndarray:
        return interquartile_mean(np.concatenate(runs, axis=axis), axis)

    return {"mean": float(together(*map(np.asarray, grounds))), "interval_95": interval(grounds, together)}


def improvement(ours: Grounds, theirs: Grounds) -> dict[str, float | list[float] | None]:
    """Probability that a run of ours has more than one of theirs on the same ground, ties counting half.

    Args:
      ours, theirs: of the same grounds, in order.

    Returns:
      The `probability`, averaged over grounds, and its interval, `interval_95`.
    """
    number = len(ours)

    def probability(*runs: np.ndarray, axis: int = -1) -> np.ndarray:
        pairs = zip(runs[:number], runs[number:], strict=True)
        return np.mean([_above(one, other, axis) for one, other in pairs], axis=0)

    runs = [*ours, *theirs]
    return {"probability": float(probability(*map(np.asarray, runs))), "interval_95": interval(runs, probability)}


def _above(high: np.ndarray, low: np.ndarray, axis: int) -> np.ndarray:
    """As `graphrl_jax.reward.statistics.share_above`, along an axis."""
    high, low = np.moveaxis(high, axis, -1), np.moveaxis(low, axis, -1)
    return np.mean((1 + np.sign(high[..., :, None] - low[..., None, :])) / 2, axis=(-2, -1))


def profile(values: Sequence[float], levels: np.ndarray) -> np.ndarray:
    """Performance profile: the share of runs with more than each level, (L,)."""
    return np.mean(np.asarray(values)[None] > levels[:, None], axis=1)
