"""Measures of order in time against scipy and slow loops, with padding."""

import itertools

import numpy as np
import pytest
from scipy.spatial.distance import cdist
from scipy.stats import kendalltau, spearmanr

from graphrl_jax.reward.alignment import cycle_consistency, kendall_tau, value_order_correlation

LENGTHS = np.array([9, 6, 8, 5])


def noisy_sequences(noise, garbage=0.0):
    """(4, 9, 3) embeddings along a line with noise, padded with garbage."""
    random = np.random.default_rng(0)
    embeddings = np.zeros((4, 9, 3), np.float32)
    embeddings += (np.arange(9) / LENGTHS[:, None])[..., None] * np.array([1, 2, -1])
    embeddings += noise * random.normal(size=embeddings.shape)
    embeddings[np.arange(9) >= LENGTHS[:, None]] = garbage
    return embeddings.astype(np.float32)


def neighbours(u, v):
    return np.argmin(cdist(u, v, "sqeuclidean"), axis=1)


@pytest.mark.parametrize("garbage", [0.0, 1e30, np.nan])
@pytest.mark.parametrize("noise", [0.0, 0.3, 2.0])
def test_kendall_tau_equals_scipy(noise, garbage):
    embeddings = noisy_sequences(noise, garbage)
    real = [embedding[:length] for embedding, length in zip(embeddings, LENGTHS, strict=True)]
    taus = [kendalltau(np.arange(len(u)), neighbours(u, v)).correlation for u, v in itertools.permutations(real, 2)]
    assert kendall_tau(embeddings, LENGTHS) == pytest.approx(np.nanmean(taus), abs=1e-5)


@pytest.mark.parametrize("garbage", [0.0, 1e30, np.nan])
@pytest.mark.parametrize("noise", [0.0, 0.3, 2.0])
def test_cycle_consistency_equals_a_loop(noise, garbage):
    embeddings = noisy_sequences(noise, garbage)
    real = [embedding[:length] for embedding, length in zip(embeddings, LENGTHS, strict=True)]
    shares = []
    for u, v, w in itertools.permutations(real, 3):
        forward = neighbours(w, u)[neighbours(v, w)[neighbours(u, v)]]
        backward = neighbours(v, u)[neighbours(w, v)[neighbours(u, w)]]
        start = np.arange(len(u))
        shares.append(np.mean((abs(forward - start) <= 1) & (abs(backward - start) <= 1)))
    assert cycle_consistency(embeddings, LENGTHS) == pytest.approx(np.mean(shares), abs=1e-5)


def test_ordered_sequences_score_one_and_reversed_ones_minus_one():
    line = np.linspace(0, 1, 9, dtype=np.float32)[:, None]
    lengths = np.array([9, 9, 9, 9])
    ordered = np.stack([line] * 4)
    assert kendall_tau(ordered, lengths) == pytest.approx(1.0)
    assert cycle_consistency(ordered, lengths) == pytest.approx(1.0)
    turned = np.stack([line, line[::-1], line, line[::-1]])
    assert kendall_tau(turned, lengths) == pytest.approx((4 - 8) / 12)


def test_kendall_tau_without_any_order_is_zero():
    assert kendall_tau(np.zeros((4, 9, 3)), LENGTHS) == 0.0


@pytest.mark.parametrize("garbage", [0.0, 1e30, np.nan])
def test_value_order_correlation_equals_scipy(garbage):
    random = np.random.default_rng(1)
    values = random.integers(0, 5, (4, 9)).astype(np.float32)
    values[0] = -np.arange(9)
    values[3] = 2.0
    values[np.arange(9) >= LENGTHS[:, None]] = garbage
    actual = value_order_correlation(values, LENGTHS)
    for index in (0, 1, 2):
        length = LENGTHS[index]
        expected = spearmanr(values[index, :length], np.arange(length)).statistic
        assert actual[index] == pytest.approx(expected, abs=1e-5)
    assert actual[0] == pytest.approx(-1.0) and actual[3] == 0.0


def test_wrong_inputs_are_named():
    with pytest.raises(ValueError, match="at least 3 sequences, got 2"):
        cycle_consistency(np.zeros((2, 9, 3)), LENGTHS[:2])
    with pytest.raises(ValueError, match="at least 2 sequences, got 1"):
        kendall_tau(np.zeros((1, 9, 3)), LENGTHS[:1])
    with pytest.raises(ValueError, match=r"must be \(B, T, D\) and lengths \(B,\), got \(4, 9\)"):
        kendall_tau(np.zeros((4, 9)), LENGTHS)
    with pytest.raises(ValueError, match=r"values must be \(B, T\)"):
        value_order_correlation(np.zeros((4, 9)), LENGTHS[:2])
