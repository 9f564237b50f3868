"""Statistics of a few runs."""

import numpy as np
import pytest

from benchmarks import statistics


def test_the_interquartile_mean_leaves_out_a_quarter_at_either_end():
    assert statistics.interquartile_mean(np.array([0.0, 0.5, 0.6, 0.7, 9.0])) == pytest.approx(0.6)
    assert statistics.interquartile_mean(np.array([[1.0, 2.0, 3.0, 100.0]] * 2)).tolist() == [2.5, 2.5]


def test_an_interval_lies_round_the_mean_and_narrows_with_runs():
    few, many = [0.2, 0.4, 0.6, 0.8, 1.0], [0.2, 0.4, 0.6, 0.8, 1.0] * 20
    found = [statistics.interquartile_mean_of([runs]) for runs in (few, many)]
    widths = []
    for one in found:
        low, high = one["interval_95"]
        assert low < one["mean"] < high and one["mean"] == pytest.approx(0.6)
        widths.append(high - low)
    assert widths[1] < widths[0] / 3
    assert statistics.interquartile_mean_of([few]) == found[0]


def test_grounds_are_resampled_apart():
    # All spread lies between the grounds, so resampling within them changes nothing.
    found = statistics.interquartile_mean_of([[0.0] * 4, [1.0] * 4])
    assert found["interval_95"] == [0.5, 0.5] == [found["mean"]] * 2


def test_one_run_has_no_interval():
    assert statistics.interquartile_mean_of([[0.5]]) == {"mean": 0.5, "interval_95": None}
    assert statistics.improvement([[0.5]], [[0.4]]) == {"probability": 1.0, "interval_95": None}


def test_improvement_counts_pairs_of_the_same_ground():
    # 3 of 4 pairs on the first ground, a tie and a loss on the second.
    ours, theirs = [[0.3, 0.9], [0.1, 0.2]], [[0.2, 0.5], [0.2, 0.2]]
    found = statistics.improvement(ours, theirs)
    assert found["probability"] == pytest.approx((0.75 + 0.25) / 2)
    low, high = found["interval_95"]
    assert 0 <= low < found["probability"] < high <= 1
    assert statistics.improvement(theirs, ours)["probability"] == pytest.approx(1 - found["probability"])


def test_a_profile_falls_from_all_runs_to_none():
    assert statistics.profile([0.2, 0.5, 1.0, 1.0], np.array([0.0, 0.2, 0.9, 1.0])).tolist() == [1.0, 0.75, 0.5, 0.0]
