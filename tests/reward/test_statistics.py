"""Shares and intervals by hand and against scipy."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from graphrl_jax.reward.statistics import interval, pair_accuracy, share_above, share_interval


def test_shares_by_hand():
    # Pairs: (0, 1) in order, (0, 2) tied in the values, (1, 2) in the wrong order; (2, 3) has no true order.
    assert pair_accuracy(np.array([1.0, 2.0, 1.0, 9.0]), np.array([1.0, 2.0, 3.0, 3.0])) == pytest.approx(3.5 / 5)
    assert share_above(np.array([1.0, 3.0]), np.array([1.0, 2.0])) == pytest.approx((0.5 + 0 + 1 + 1) / 4)


def test_one_order_is_right_its_reverse_wrong_and_a_constant_in_between():
    truth = np.random.default_rng(0).normal(size=20)
    assert pair_accuracy(truth**3, truth) == 1.0
    assert pair_accuracy(-truth, truth) == 0.0
    assert pair_accuracy(np.zeros(20), truth) == 0.5


@settings(max_examples=30, deadline=None)
@given(st.lists(st.integers(0, 5), min_size=1, max_size=8), st.lists(st.integers(0, 5), min_size=1, max_size=8))
def test_share_above_is_the_auroc(high, low):
    # Mann-Whitney's U counts the pairs, ties half.
    expected = stats.mannwhitneyu(high, low).statistic / (len(high) * len(low))
    assert share_above(np.array(high), np.array(low)) == pytest.approx(expected)
    assert share_above(np.array(low), np.array(high)) == pytest.approx(1 - expected)


def test_an_interval_is_students():
    values = [0.4, 0.5, 0.7, 0.45]
    low, high = stats.t.interval(0.95, 3, loc=np.mean(values), scale=stats.sem(values))
    assert interval(values) == pytest.approx([low, high])
    low, high = stats.t.interval(0.5, 3, loc=np.mean(values), scale=stats.sem(values))
    assert interval(values, confidence=0.5) == pytest.approx([low, high])


def test_an_interval_of_shares_is_cut_and_a_single_value_has_none():
    assert interval([0.0, 1.0]) == [0.0, 1.0]
    assert interval([0.9, 1.0, 1.0])[1] == 1.0
    assert interval([0.5, 0.5]) == [0.5, 0.5]
    assert interval([0.5]) is None and interval([]) is None


def test_the_interval_of_a_share_is_wilsons():
    # By hand for 0 of 16: from 0 to z^2 / (16 + z^2).
    z = stats.norm.ppf(0.975)
    assert share_interval(0.0, 16) == pytest.approx((0.0, z**2 / (16 + z**2)))
    low, high = share_interval(0.75, 8)
    assert 0 < low < 0.75 < high < 1 and share_interval(0.25, 8) == pytest.approx((1 - high, 1 - low))
