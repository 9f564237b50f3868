"""Finished runs put together."""

import pytest

from benchmarks.finished import together


def test_a_methods_row_is_the_mean_over_its_members():
    row = together([{"success_rate": 1.0, "mean_score": 1.0}, {"success_rate": 0.5, "mean_score": 0.8}])
    assert row["success_rate"] == 0.75 and row["mean_score"] == pytest.approx(0.9)
    low, high = row["success_interval_95"]
    assert low < 0.5 and high == 1.0
