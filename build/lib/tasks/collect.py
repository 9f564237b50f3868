"""Collection of scripted episodes until every requested kind is complete."""

from collections.abc import Callable
from typing import Any

import jax
import numpy as np

Rollouts = Callable[[jax.Array, np.ndarray], tuple[Any, np.ndarray]]
"""Runs an episode of each kind in `kinds` (B,); returns leaves (B, ...) and which episodes succeeded, (B,) bool."""


def collect(
    rollouts: Rollouts, key: jax.Array, successes: int, failures: int, failure_kinds: int, batch: int, max_batches: int
) -> tuple[Any, np.ndarray]:
    """Collects `successes` episodes that really succeed and `failures` that really fail, of every kind in turn.

    Episodes that do not end as planned are dropped.

    Args:
      rollouts: runs a batch of `batch` episodes; kind 0 is a success, 1 to `failure_kinds` are failures.

    Returns:
      The leaves returned by `rollouts`, and the kinds (successes + failures,), sorted.

    Raises:
      ValueError: the expert fails so often that the wanted number is not reached in `max_batches` batches.
    """
    wanted = np.array([0] * successes + [1 + i % failure_kinds for i in range(failures)])
    parts: list[tuple[Any, np.ndarray]] = []
    for batch_key in jax.random.split(key, max_batches):
        missing = wanted if not parts else _missing(wanted, np.concatenate([kinds for _, kinds in parts]))
        if not missing.size:
            break
        kinds = np.resize(missing, batch)
        episodes, solved = rollouts(batch_key, kinds)
        as_planned = solved == (kinds == 0)
        parts.append((jax.tree.map(lambda leaf, kept=as_planned: leaf[kept], episodes), kinds[as_planned]))
    episodes = jax.tree.map(lambda *leaves: np.concatenate(leaves), *(episodes for episodes, _ in parts))
    kinds = np.concatenate([kinds for _, kinds in parts])
    if _missing(wanted, kinds).size:
        raise ValueError(f"the expert reached {len(kinds)} of {len(wanted)} demonstrations in {max_batches} batches")
    chosen = np.concatenate([np.flatnonzero(kinds == kind)[: np.sum(wanted == kind)] for kind in np.unique(wanted)])
    return jax.tree.map(lambda leaf: leaf[chosen], episodes), kinds[chosen]


def _missing(wanted: np.ndarray, found: np.ndarray) -> np.ndarray:
    """The kinds that are missing in `found`, each as often as it is missing."""
    number = 1 + max(wanted.max(initial=0), found.max(initial=0))
    counts = np.bincount(wanted, minlength=number) - np.bincount(found, minlength=number)
    return np.repeat(np.arange(number), np.maximum(counts, 0))
