"""Soft temporal cycle-consistency (TCC): a frame matched softly to another sequence and back must return to itself.

Dwibedi et al. 2019, in the deterministic form of XIRL's `losses.py` (Zakka et al. 2021): every ordered pair of
sequences, squared Euclidean similarity divided by D and the temperature. For L2-normalised embeddings XIRL omits the
division by D; divide the temperature by D here to do the same.
"""

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike

from graphrl_jax.pretrain.config import TCC_LOSSES, TCCLoss

HUBER_DELTA = 0.1
LABEL_SMOOTHING = 0.1
VARIANCE_WEIGHT = 0.001
# XIRL takes the plain logarithm, which is -inf if a frame cycles back to itself with certainty.
VARIANCE_EPSILON = 1e-6

# Finite in place of minus infinity, so that a softmax over masked entries alone and its gradient stay finite.
_MASKED_LOGIT = -1e30


def matching_logits(a: jax.Array, b: jax.Array, b_mask: jax.Array, scale: ArrayLike) -> jax.Array:
    """Similarity logits of a_i and b_j for a softmax over j: -scale ||a_i - b_j||^2 without the term of ||a_i||^2.

    That term is constant along a row and changes no softmax; leaving it out saves computation per pair.

    Args:
      a, b: (T, D) and (S, D) float32.
      b_mask: (S,) bool, False for padding.
      scale: factor on squared distances.

    Returns:
      (T, S) float32; padded j have a logit of about minus infinity.
    """
    offsets = jnp.where(b_mask, -scale * jnp.sum(b**2, axis=-1), _MASKED_LOGIT)
    # Full precision: accelerators round the factors of a matrix product, and a softmax magnifies the error.
    return jnp.matmul(2.0 * scale * a, b.T, precision=jax.lax.Precision.HIGHEST) + offsets[None, :]


def cycle_logits(u: jax.Array, v: jax.Array, u_mask: jax.Array, v_mask: jax.Array, temperature: ArrayLike) -> jax.Array:
    """Logits of cycling from frame i of u, through its soft nearest neighbour in v, back to frame k of u.

    s(a, b) = -||a - b||^2 / (D temperature); p_ij = softmax_j s(u_i, v_j); nn_i = sum_j p_ij v_j; the result is
    s(nn_i, u_k) up to a constant along k.

    Args:
      u, v: (T, D) and (S, D) float32.
      u_mask, v_mask: (T,) and (S,) bool, False for padding.
      temperature: softmax temperature.

    Returns:
      (T, T) float32; padded frames k have a logit of about minus infinity.
    """
    scale = 1.0 / (u.shape[-1] * jnp.asarray(temperature, jnp.float32))
    u = jnp.where(u_mask[:, None], u, 0.0)
    v = jnp.where(v_mask[:, None], v, 0.0)
    matches = jax.nn.softmax(matching_logits(u, v, v_mask, scale), axis=-1)
    neighbours = jnp.matmul(matches, v, precision=jax.lax.Precision.HIGHEST)
    return matching_logits(neighbours, u, u_mask, scale)


def cycle_loss(
    u: jax.Array,
    v: jax.Array,
    u_mask: jax.Array,
    v_mask: jax.Array,
    u_times: jax.Array,
    temperature: ArrayLike,
    loss: TCCLoss = "regression_mse",
) -> jax.Array:
    """Mean loss over the real frames of u, cycled through v.

    Args:
      u, v, u_mask, v_mask, temperature: see `cycle_logits`.
      u_times: (T,) float32, frame_index / video_length.
      loss: `regression_mse` (mu_i - t_i)^2; `regression_mse_var` exp(-log var_i) (mu_i - t_i)^2 + 0.001 log var_i;
        `regression_huber` with delta 0.1; `classification` cross-entropy on the logits, label smoothing 0.1.

    Returns:
      A float32 scalar; zero if u has no real frame.

    Raises:
      ValueError: the loss is unknown.
    """
    logits = cycle_logits(u, v, u_mask, v_mask, temperature)
    if loss == "classification":
        losses = _classification(logits, u_mask)
    elif loss in TCC_LOSSES:
        losses = _regression(logits, jnp.where(u_mask, u_times, 0.0), loss)
    else:
        raise ValueError(f"the TCC loss is {loss!r}; allowed: {', '.join(TCC_LOSSES)}")
    return jnp.sum(jnp.where(u_mask, losses, 0.0)) / jnp.maximum(jnp.sum(u_mask.astype(jnp.float32)), 1.0)


def _regression(logits: jax.Array, times: jax.Array, loss: TCCLoss) -> jax.Array:
    """(T,) losses of the time mu_i = sum_k beta_ik t_k to which each frame returns."""
    beta = jax.nn.softmax(logits, axis=-1)
    mean = beta @ times
    error = mean - times
    if loss == "regression_mse":
        return error**2
    if loss == "regression_huber":
        size = jnp.abs(error)
        return jnp.where(size <= HUBER_DELTA, 0.5 * error**2, HUBER_DELTA * size - 0.5 * HUBER_DELTA**2)
    variance = jnp.sum(beta * (times[None, :] - mean[:, None]) ** 2, axis=-1)
    log_variance = jnp.log(variance + VARIANCE_EPSILON)
    return jnp.exp(-log_variance) * error**2 + VARIANCE_WEIGHT * log_variance


def _classification(logits: jax.Array, mask: jax.Array) -> jax.Array:
    """(T,) cross-entropies with XIRL's smoothing: (1 - s) on the true frame plus s / (K - 1) on all K real ones."""
    log_beta = jax.nn.log_softmax(logits, axis=-1)
    spread = LABEL_SMOOTHING / jnp.maximum(jnp.sum(mask.astype(jnp.float32)) - 1.0, 1.0)
    everywhere = jnp.sum(jnp.where(mask[None, :], log_beta, 0.0), axis=-1)
    return -(1.0 - LABEL_SMOOTHING) * jnp.diagonal(log_beta) - spread * everywhere


def tcc_loss(
    embeddings: jax.Array,
    mask: jax.Array,
    times: jax.Array,
    temperature: ArrayLike,
    loss: TCCLoss = "regression_mse",
) -> jax.Array:
    """Mean of `cycle_loss` over all ordered pairs of different sequences that both have a real frame.

    Args:
      embeddings: (B, T, D) float32.
      mask: (B, T) bool, False for padding.
      times: (B, T) float32, frame_index / video_length.
      temperature, loss: see `cycle_loss`.

    Returns:
      A float32 scalar; zero if there is no pair.
    """

    def pair_loss(u: tuple, v: tuple) -> jax.Array:
        return cycle_loss(u[0], v[0], u[1], v[1], u[2], temperature, loss)

    sequences = (embeddings, mask, times)
    losses = jax.vmap(jax.vmap(pair_loss, in_axes=(None, 0)), in_axes=(0, None))(sequences, sequences)
    present = jnp.any(mask, axis=-1)
    pairs = present[:, None] & present[None, :] & ~jnp.eye(mask.shape[0], dtype=bool)
    return jnp.sum(jnp.where(pairs, losses, 0.0)) / jnp.maximum(jnp.sum(pairs.astype(jnp.float32)), 1.0)


def loss_of_one_point(num_frames: int, loss: TCCLoss = "regression_mse") -> jax.Array:
    """The TCC of an encoder that maps all frames to one point: about 1/12 for `regression_mse`. It is a saddle point.

    Args:
      num_frames: T, frames per sequence.
      loss: see `cycle_loss`.
    """
    times = jnp.broadcast_to(jnp.arange(num_frames) / num_frames, (2, num_frames))
    return tcc_loss(jnp.zeros((2, num_frames, 1)), jnp.ones_like(times, bool), times, 1.0, loss)
