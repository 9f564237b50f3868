"""Statistics over seeds and pairs: confidence intervals, and how often one value exceeds another."""

import math
from collections.abc import Sequence

import numpy as np
from scipy.stats import binomtest
from scipy.stats import t as student


def interval(values: Sequence[float], confidence: float = 0.95) -> list[float] | None:
    """Student's confidence interval of the mean of shares, clipped to [0, 1]; None for fewer than two values."""
    if len(values) < 2:
        return None
    half = student.ppf((1 + confidence) / 2, len(values) - 1) * np.std(values, ddof=1) / math.sqrt(len(values))
    return [max(0.0, float(np.mean(values) - half)), min(1.0, float(np.mean(values) + half))]


def share_interval(share: float, count: int, confidence: float = 0.95) -> tuple[float, float]:
    """Wilson's confidence interval of the probability of which `count` independent trials showed this share."""
    found = binomtest(round(share * count), count).proportion_ci(confidence, method="wilson")
    return float(found.low), float(found.high)


def pair_accuracy(values: np.ndarray, truth: np.ndarray) -> float:
    """Share of pairs with different `truth` (M,) that `values` (M,) puts in the same order; ties count half."""
    value_order = np.sign(values[:, None] - values[None])
    true_order = np.sign(truth[:, None] - truth[None])
    decided = np.triu(true_order != 0, 1)
    return float(np.mean((1 + value_order[decided] * true_order[decided]) / 2))


def share_above(high: np.ndarray, low: np.ndarray) -> float:
    """Share of all pairs in which a value of `high` (P,) exceeds one of `low` (Q,), ties count half: the AUROC."""
    difference = np.sign(np.ravel(high)[:, None] - np.ravel(low)[None])
    return float(np.mean((1 + difference) / 2))
