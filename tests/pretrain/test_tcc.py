"""Soft TCC against a slow reference in plain numpy, with padding."""

from functools import partial

import jax
import numpy as np
import pytest

from graphrl_jax.pretrain.config import TCC_LOSSES
from graphrl_jax.pretrain.tcc import cycle_loss, loss_of_one_point, tcc_loss

PAIR = jax.jit(cycle_loss, static_argnames="loss")
BATCH = jax.jit(tcc_loss, static_argnames="loss")
TEMPERATURE = 0.3


def softmax(logits):
    weights = np.exp(logits - np.max(logits))
    return weights / np.sum(weights)


def reference_pair(u, v, times, temperature, kind):
    """Mean loss over the frames of u, cycled by way of v; no padding, one frame at a time."""
    dimension = u.shape[1]
    losses = []
    for i in range(len(u)):
        p = softmax(np.array([-np.sum((u[i] - b) ** 2) / (dimension * temperature) for b in v]))
        neighbour = sum(p[j] * v[j] for j in range(len(v)))
        logits = np.array([-np.sum((neighbour - a) ** 2) / (dimension * temperature) for a in u])
        beta = softmax(logits)
        mu = sum(beta[k] * times[k] for k in range(len(u)))
        if kind == "regression_mse":
            loss = (mu - times[i]) ** 2
        elif kind == "regression_huber":
            error = abs(mu - times[i])
            loss = 0.5 * error**2 if error <= 0.1 else 0.1 * (error - 0.05)
        elif kind == "regression_mse_var":
            variance = sum(beta[k] * (times[k] - mu) ** 2 for k in range(len(u))) + 1e-6
            loss = (mu - times[i]) ** 2 / variance + 0.001 * np.log(variance)
        else:
            targets = np.full(len(u), 0.1 / (len(u) - 1))
            targets[i] += 0.9
            loss = -np.sum(targets * np.log(beta))
        losses.append(loss)
    return np.mean(losses)


def padded_sequences(garbage=0.0):
    """Three random sequences of 7, 4 and 5 frames, padded to 7, with times of every second frame of a video."""
    random = np.random.default_rng(0)
    lengths = np.array([7, 4, 5])
    mask = np.arange(7) < lengths[:, None]
    embeddings = random.normal(size=(3, 7, 3)).astype(np.float32)
    times = (np.arange(7) * 2 / (2 * lengths[:, None])).astype(np.float32)
    embeddings[~mask] = garbage
    times[~mask] = garbage
    return embeddings, mask, times, lengths


@pytest.mark.parametrize("kind", TCC_LOSSES)
def test_pair_loss_equals_the_reference(kind):
    embeddings, mask, times, lengths = padded_sequences(garbage=1e3)
    for first, second in ((0, 1), (1, 0), (1, 2)):
        actual = PAIR(embeddings[first], embeddings[second], mask[first], mask[second], times[first], TEMPERATURE, kind)
        u, v = embeddings[first, : lengths[first]], embeddings[second, : lengths[second]]
        expected = reference_pair(*map(np.float64, (u, v, times[first, : lengths[first]])), TEMPERATURE, kind)
        np.testing.assert_allclose(actual, expected, rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("kind", TCC_LOSSES)
def test_batch_loss_is_the_mean_over_all_ordered_pairs(kind):
    embeddings, mask, times, lengths = padded_sequences()
    expected = [
        reference_pair(
            *map(np.float64, (embeddings[i, : lengths[i]], embeddings[j, : lengths[j]], times[i, : lengths[i]])),
            TEMPERATURE,
            kind,
        )
        for i in range(3)
        for j in range(3)
        if i != j
    ]
    np.testing.assert_allclose(BATCH(embeddings, mask, times, TEMPERATURE, kind), np.mean(expected), rtol=1e-4)


@pytest.mark.parametrize("garbage", [1e30, np.nan, -np.inf])
@pytest.mark.parametrize("kind", TCC_LOSSES)
def test_padding_reaches_neither_loss_nor_gradient(kind, garbage):
    gradient = GRADIENTS[kind]
    clean, mask, times, _ = padded_sequences()
    dirty, _, dirty_times, _ = padded_sequences(garbage)
    expected, expected_gradient = gradient(clean, mask, times, TEMPERATURE)
    actual, actual_gradient = gradient(dirty, mask, dirty_times, TEMPERATURE)
    np.testing.assert_array_equal(actual, expected)
    np.testing.assert_array_equal(actual_gradient, expected_gradient)
    np.testing.assert_array_equal(np.asarray(actual_gradient)[~mask], 0.0)


GRADIENTS = {kind: jax.jit(jax.value_and_grad(partial(tcc_loss, loss=kind))) for kind in TCC_LOSSES}


@pytest.mark.parametrize("kind", TCC_LOSSES)
def test_a_sequence_without_frames_takes_part_in_no_pair(kind):
    embeddings, mask, times, _ = padded_sequences()
    fewer = mask.copy()
    fewer[2] = False
    loss, gradient = GRADIENTS[kind](embeddings, fewer, times, TEMPERATURE)
    u_to_v = PAIR(embeddings[0], embeddings[1], mask[0], mask[1], times[0], TEMPERATURE, kind)
    v_to_u = PAIR(embeddings[1], embeddings[0], mask[1], mask[0], times[1], TEMPERATURE, kind)
    np.testing.assert_allclose(loss, (u_to_v + v_to_u) / 2, rtol=1e-5)
    assert np.isfinite(gradient).all()
    nothing, gradient = GRADIENTS[kind](embeddings, np.zeros_like(mask), times, TEMPERATURE)
    assert float(nothing) == 0.0
    np.testing.assert_array_equal(gradient, 0.0)


@pytest.mark.parametrize("kind", ["regression_mse", "regression_huber"])
def test_identical_sequences_with_frames_far_apart_cost_nothing(kind):
    frames = np.float32(30.0) * np.eye(7, dtype=np.float32)[:, :3] + np.arange(7, dtype=np.float32)[:, None] * 30
    sequences = np.stack([frames] * 3)
    times = np.stack([np.arange(7) / 7] * 3).astype(np.float32)
    assert float(BATCH(sequences, np.ones((3, 7), bool), times, TEMPERATURE, kind)) < 1e-10


def test_without_any_structure_every_frame_comes_back_to_the_mean_time():
    times = (np.arange(7) / 7).astype(np.float32)
    loss = BATCH(np.zeros((3, 7, 3), np.float32), np.ones((3, 7), bool), np.stack([times] * 3), 1.0, "regression_mse")
    np.testing.assert_allclose(loss, np.var(times), rtol=1e-5)


def test_an_unknown_loss_lists_the_known_ones():
    embeddings, mask, times, _ = padded_sequences()
    with pytest.raises(ValueError, match="the TCC loss is 'mse'; allowed: regression_mse, .*classif"):
        tcc_loss(embeddings, mask, times, 1.0, "mse")


def test_the_loss_of_one_point_is_the_spread_of_times():
    assert loss_of_one_point(40) == pytest.approx((1 - 1 / 40**2) / 12, rel=1e-4)
    assert loss_of_one_point(2) == pytest.approx(1 / 16)
    # Each frame is as likely as any other.
    assert loss_of_one_point(5, "classification") == pytest.approx(0.9 * np.log(5) + 0.1 * 5 / 4 * np.log(5), rel=1e-5)
