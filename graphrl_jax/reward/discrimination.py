"""Discrimination of successes from failures by a reward: the paper's rho (Eq. 4) and complementary metrics."""

import math
from typing import Any

import numpy as np

from graphrl_jax.reward.alignment import value_order_correlation
from graphrl_jax.reward.statistics import share_above

DISCOUNT = 0.99
"""Per frame."""


def discrimination(rewards: np.ndarray, lengths: np.ndarray, success: np.ndarray) -> dict[str, Any]:
    """Rho (Eq. 4) and complementary metrics.

    Rewards are negative, so a small rho is good: successes lose less reward than failures. Rho depends on the length of
    episodes. It is therefore also computed on mean rewards, and reported with metrics that do not depend on scale.

    Args:
      rewards: (B, T) float; padding after an episode's length is ignored.
      lengths: (B,) int.
      success: (B,) bool, with at least one success and one failure.

    Returns:
      rho: mean cumulative reward of successes divided by that of failures (Eq. 4).
      rho_per_step: rho on each episode's mean reward.
      auroc: share of (success, failure) pairs in which the success has more cumulative reward; ties count half.
      auroc_discounted: auroc on each episode's cumulative reward, discounted by `DISCOUNT` per frame.
      auroc_per_step: auroc on each episode's mean reward.
      final_auroc: auroc on the reward of the last frame.
      order_success, order_failure: mean rank correlation of reward with time.
      successes, failures: number of each.

    Raises:
      ValueError: there are no successes or no failures.
    """
    success = np.asarray(success, bool)
    if success.all() or not success.any():
        raise ValueError(f"discrimination needs successes and failures, got {success.sum()} of {len(success)}")
    real = np.arange(rewards.shape[1]) < np.asarray(lengths)[:, None]
    sums = np.where(real, rewards, 0.0).sum(1)
    means = sums / lengths
    discounted = np.where(real, rewards * DISCOUNT ** np.arange(rewards.shape[1]), 0.0).sum(1)
    last = rewards[np.arange(len(rewards)), np.asarray(lengths) - 1]
    order = value_order_correlation(rewards, lengths)
    return {
        "rho": _ratio(sums, success),
        "rho_per_step": _ratio(means, success),
        "auroc": share_above(sums[success], sums[~success]),
        "auroc_discounted": share_above(discounted[success], discounted[~success]),
        "auroc_per_step": share_above(means[success], means[~success]),
        "final_auroc": share_above(last[success], last[~success]),
        "order_success": float(order[success].mean()),
        "order_failure": float(order[~success].mean()),
        "successes": int(success.sum()),
        "failures": int((~success).sum()),
    }


def _ratio(values: np.ndarray, success: np.ndarray) -> float:
    failed = float(values[~success].mean())
    return float(values[success].mean()) / failed if failed else math.nan
