"""How well a reward tells successes from failures: the paper's rho (Eq. 4) and what it should be read beside."""

import math
from typing import Any

import numpy as np

from graphrl_jax.evaluators import value_order_correlation
from graphrl_jax.landscape import share_above


def discrimination(rewards: np.ndarray, lengths: np.ndarray, success: np.ndarray) -> dict[str, Any]:
    """Eq. 4 and its companions.

    Rewards are negative, so a small rho is good: successes lose less on the way than failures. It depends on how long
    episodes are; hence the same of mean rewards, and measures that know no scale.

    Args:
      rewards: (B, T) float; what lies behind a length means nothing.
      lengths: (B,) int.
      success: (B,) bool, at least one of each.

    Returns:
      rho: mean cumulative reward of successes over that of failures (Eq. 4).
      rho_per_step: the same of each episode's mean reward.
      auroc: share of (success, failure) pairs in which the success has more cumulative reward, ties half.
      auroc_per_step: the same of each episode's mean reward.
      final_auroc: the same of the last frame's reward.
      order_success, order_failure: mean rank correlation of reward with time.
      successes, failures: how many there are.

    Raises:
      ValueError: there are no successes or no failures.
    """
    success = np.asarray(success, bool)
    if success.all() or not success.any():
        raise ValueError(f"discrimination needs successes and failures, got {success.sum()} of {len(success)}")
    real = np.arange(rewards.shape[1]) < np.asarray(lengths)[:, None]
    sums = np.where(real, rewards, 0.0).sum(1)
    means = sums / lengths
    last = rewards[np.arange(len(rewards)), np.asarray(lengths) - 1]
    order = value_order_correlation(rewards, lengths)
    return {
        "rho": _ratio(sums, success),
        "rho_per_step": _ratio(means, success),
        "auroc": share_above(sums[success], sums[~success]),
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
