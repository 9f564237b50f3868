"""Metrics of temporal alignment: Kendall's tau, cycle consistency, value-order correlation.

Kendall's tau and three-way cycle consistency are XIRL's evaluators (Zakka et al. 2021) with squared Euclidean nearest
neighbours and stride 1. Inputs are padded and come with their lengths; padding is ignored.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from graphrl_jax.pretrain.tcc import matching_logits


def kendall_tau(embeddings: ArrayLike, lengths: ArrayLike) -> float:
    """Mean over ordered pairs (u, v) of Kendall's tau-b between frames of u and their nearest neighbours in v.

    Pairs without a tau (all frames share one neighbour) are left out, as in XIRL; without any pair the result is 0.

    Args:
      embeddings: (B, T, D) float32.
      lengths: (B,) int, real frames of each sequence.

    Returns:
      A float in [-1, 1]; 1 if nearest neighbours always run forward in time.

    Raises:
      ValueError: there are fewer than two sequences, or shapes do not match.
    """
    return float(_mean_tau(*_checked(embeddings, lengths, least=2)))


def cycle_consistency(embeddings: ArrayLike, lengths: ArrayLike) -> float:
    """Three-way cycle consistency: share of frames that return to within one frame of themselves.

    For every ordered triple (u, v, w), a frame of u is mapped to its nearest neighbour in v, then in w, then in u. It
    must return in this order and also in the order w, v. The mean runs over frames, then over triples.

    Args:
      embeddings: (B, T, D) float32.
      lengths: (B,) int, real frames of each sequence.

    Returns:
      A float in [0, 1].

    Raises:
      ValueError: there are fewer than three sequences, or shapes do not match.
    """
    return float(_mean_consistency(*_checked(embeddings, lengths, least=3)))


def value_order_correlation(values: ArrayLike, lengths: ArrayLike) -> np.ndarray:
    """Spearman's rank correlation of a reward with time: high on successes, low on failures.

    Args:
      values: (B, T) float32, for example `model.demonstration_rewards`.
      lengths: (B,) int, real frames of each sequence.

    Returns:
      (B,) float32 in [-1, 1]; 0 for a sequence whose values are all equal.

    Raises:
      ValueError: shapes do not match.
    """
    values, lengths = np.asarray(values, np.float32), np.asarray(lengths, np.int32)
    if values.ndim != 2 or lengths.shape != values.shape[:1]:
        raise ValueError(f"values must be (B, T) and lengths (B,), got {values.shape} and {lengths.shape}")
    return np.asarray(_time_correlations(values, lengths))


def _checked(embeddings: ArrayLike, lengths: ArrayLike, least: int) -> tuple[np.ndarray, np.ndarray]:
    """The arguments as arrays, after a check of their shapes."""
    embeddings, lengths = np.asarray(embeddings, np.float32), np.asarray(lengths, np.int32)
    if embeddings.ndim != 3 or lengths.shape != embeddings.shape[:1]:
        raise ValueError(f"embeddings must be (B, T, D) and lengths (B,), got {embeddings.shape} and {lengths.shape}")
    if len(lengths) < least:
        raise ValueError(f"this evaluator compares at least {least} sequences, got {len(lengths)}")
    return embeddings, lengths


def _neighbours(embeddings: jax.Array, lengths: jax.Array) -> jax.Array:
    """(B, B, T) int32 [u, v, t]: the real frame of v nearest to frame t of u."""
    real = _real(embeddings.shape[1], lengths)
    embeddings = jnp.where(real[..., None], embeddings, 0.0)

    def nearest(u: jax.Array, v: jax.Array, v_real: jax.Array) -> jax.Array:
        return jnp.argmax(matching_logits(u, v, v_real, 1.0), axis=-1)

    # A loop over u saves memory: all B^2 distance matrices together are (64, 64, 121, 121) for an ordinary data set.
    return jax.lax.map(lambda u: jax.vmap(nearest, in_axes=(None, 0, 0))(u, embeddings, real), embeddings)


def _real(num_frames: int, lengths: jax.Array) -> jax.Array:
    """(B, T) bool, True for real frames."""
    return jnp.arange(num_frames)[None, :] < lengths[:, None]


@jax.jit
def _mean_tau(embeddings: jax.Array, lengths: jax.Array) -> jax.Array:
    neighbours = _neighbours(embeddings, lengths)
    real = _real(embeddings.shape[1], lengths)
    taus = jax.lax.map(lambda row: jax.vmap(_tau_b, in_axes=(0, None))(*row), (neighbours, real))
    counted = jnp.isfinite(taus) & ~jnp.eye(len(lengths), dtype=bool)
    return jnp.sum(jnp.where(counted, taus, 0.0)) / jnp.maximum(jnp.sum(counted), 1)


def _tau_b(values: jax.Array, real: jax.Array) -> jax.Array:
    """Kendall's tau-b of (T,) values with time over real frames; NaN if all of them are equal."""
    frames = jnp.arange(values.shape[0])
    later = (frames[None, :] > frames[:, None]) & real[None, :] & real[:, None]
    signs = jnp.where(later, jnp.sign(values[None, :] - values[:, None]), 0).astype(jnp.float32)
    # Time has no ties, so only ties of the values reduce the denominator.
    return jnp.sum(signs) / jnp.sqrt(jnp.sum(later).astype(jnp.float32) * jnp.sum(jnp.abs(signs)))


@jax.jit
def _mean_consistency(embeddings: jax.Array, lengths: jax.Array) -> jax.Array:
    neighbours = _neighbours(embeddings, lengths)
    batch, num_frames = embeddings.shape[:2]
    frames = jnp.arange(num_frames)
    real = _real(num_frames, lengths)

    def comes_home(u: jax.Array, v: jax.Array, w: jax.Array) -> jax.Array:
        there = neighbours[v, w][neighbours[u, v]]
        return jnp.abs(neighbours[w, u][there] - frames) <= 1

    def share(u: jax.Array, v: jax.Array, w: jax.Array) -> jax.Array:
        consistent = comes_home(u, v, w) & comes_home(u, w, v) & real[u]
        different = (u != v) & (v != w) & (u != w)
        return jnp.where(different, jnp.sum(consistent) / lengths[u], 0.0)

    indices = jnp.arange(batch)
    over_v_and_w = jax.vmap(jax.vmap(share, in_axes=(None, None, 0)), in_axes=(None, 0, None))
    shares = jax.lax.map(lambda u: over_v_and_w(u, indices, indices), indices)
    return jnp.sum(shares) / (batch * (batch - 1) * (batch - 2))


@jax.jit
def _time_correlations(values: jax.Array, lengths: jax.Array) -> jax.Array:
    return jax.vmap(_time_correlation)(values, _real(values.shape[1], lengths))


def _time_correlation(values: jax.Array, real: jax.Array) -> jax.Array:
    """Pearson's correlation of the ranks of (T,) values with time over real frames; ties share their mean rank."""
    weights = real.astype(jnp.float32)
    count = jnp.sum(weights)
    below = jnp.sum((values[None, :] < values[:, None]) * weights[None, :], axis=-1)
    equal = jnp.sum((values[None, :] == values[:, None]) * weights[None, :], axis=-1)
    ranks = below + (equal - 1.0) / 2.0
    mean_rank = (count - 1.0) / 2.0
    rank_deviation = weights * (ranks - mean_rank)
    time_deviation = weights * (jnp.arange(values.shape[0]) - mean_rank)
    spread = jnp.sqrt(jnp.sum(rank_deviation**2) * jnp.sum(time_deviation**2))
    return jnp.where(spread > 0, jnp.sum(rank_deviation * time_deviation) / jnp.where(spread > 0, spread, 1.0), 0.0)
