"""Stages: known steps are found, and the measures agree with hand arithmetic."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from graphrl_jax import stages


def steps(boundaries: list[int], length: int, noise: float, seed: int = 0) -> np.ndarray:
    """A profile that rises by one at every boundary."""
    frames = np.arange(length)[:, None]
    return (frames >= np.array(boundaries)).sum(1) + np.random.default_rng(seed).normal(0, noise, length)


def way_with_rests(moves: list[tuple[int, int]], length: int, noise: float) -> np.ndarray:
    """A path in the plane that goes on by one, along a new direction, between the frames of every move."""
    frames = np.arange(length)[:, None]
    done = np.clip((frames - np.array([a for a, _ in moves])) / np.array([b - a for a, b in moves]), 0, 1)
    directions = np.array([[np.cos(i), np.sin(i)] for i in range(len(moves))])
    return done @ directions + np.random.default_rng(0).normal(0, noise, (length, 2))


@pytest.mark.parametrize("noise", [0.0, 0.002, 0.01])
def test_rests_begin_where_moves_end(noise):
    found = stages.rests(way_with_rests([(40, 80), (140, 190), (230, 270)], 320, noise), 3.0)
    assert len(found) == 3
    np.testing.assert_allclose(found, [80, 190, 270], atol=4)


def test_what_always_or_never_rests_has_no_stages():
    assert stages.rests(np.zeros((100, 2)), 1.0) == []
    assert stages.rests(way_with_rests([(0, 100)], 100, 0.0), 1.0) == []
    # Nor does what only slows down.
    slows = np.interp(np.arange(100), [0, 40, 60, 100], [0.0, 0.44, 0.55, 1.0])[:, None]
    assert stages.rests(slows, 1.0) == []
    assert stages.rests(np.zeros((3, 2)), 1.0) == []


@pytest.mark.parametrize("noise", [0.0, 0.02, 0.1])
def test_change_points_are_where_a_profile_steps(noise):
    found = stages.change_points(steps([60, 150, 240], 300, noise))
    assert len(found) == 3
    np.testing.assert_allclose(found, [60, 150, 240], atol=2)


def test_a_profile_without_steps_has_no_change_points():
    assert stages.change_points(np.random.default_rng(0).normal(0, 0.1, 300)) == []
    assert stages.change_points(np.zeros(300)) == []
    assert stages.change_points(np.zeros(3)) == []


def test_uvd_finds_where_the_way_turns():
    # Out and back along a line, then off at a right angle: two turns.
    out = np.linspace(0, 1, 100)
    path = np.stack([np.concatenate([out, out[::-1], 0 * out]), np.concatenate([0 * out, 0 * out, out])], axis=1)
    found = stages.uvd(path)
    assert found and abs(found[0] - 100) <= 6
    assert stages.uvd(np.stack([out, 0 * out], axis=1)) == []


def test_true_boundaries_are_the_events_inside():
    assert stages.true_boundaries(np.array([40, -1, 10, 40, 0, 99]), 99) == [10, 40]


def test_f1_by_hand():
    # 100 frames, tolerance 2: 10 matches 12, 50 is missed, 70 and 71 compete for 70.
    assert stages.boundary_f1([12, 70, 71], [10, 50, 70], 100, 0.02) == pytest.approx(2 * 2 / 6)
    assert stages.boundary_f1([], [], 100, 0.02) == 1.0
    assert stages.boundary_f1([5], [], 100, 0.02) == 0.0 == stages.boundary_f1([], [5], 100, 0.02)


def test_covering_by_hand():
    # True stages of 40 and 60 frames; found ones of 50 and 50: overlaps 40 / 50 and 50 / 60.
    assert stages.covering([50], [40], 100) == pytest.approx(0.4 * 40 / 50 + 0.6 * 50 / 60)
    assert stages.covering([], [50], 100) == pytest.approx(0.5)


@settings(max_examples=50, deadline=None)
@given(st.sets(st.integers(1, 199), max_size=6), st.sets(st.integers(1, 199), max_size=6))
def test_measures_lie_between_0_and_1_and_are_1_for_the_truth(found, true):
    found, true = sorted(found), sorted(true)
    assert stages.boundary_f1(true, true, 200, 0.0) == 1.0 and stages.covering(true, true, 200) == pytest.approx(1.0)
    scores = [stages.boundary_f1(found, true, 200, tolerance) for tolerance in (0.0, 0.01, 0.05, 1.0)]
    assert scores == sorted(scores) and 0.0 <= scores[0] and scores[-1] <= 1.0
    assert 0.0 < stages.covering(found, true, 200) <= 1.0 + 1e-9


def test_judge_is_a_mean_over_episodes():
    judged = stages.judge([[50], []], [[50], [30]], np.array([100, 100]))
    assert judged["f1_at_1%"] == 0.5 and judged["found"] == 0.5 and judged["true"] == 1.0
    assert judged["covering"] == pytest.approx((1.0 + 0.3 * 0.3 + 0.7 * 0.7) / 2)
