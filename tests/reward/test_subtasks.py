"""Subtasks: known steps are found, and the measures agree with hand arithmetic."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from graphrl_jax.reward import subtasks
from tests.helpers.demonstrations import demonstrations


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
    found = subtasks.rests(way_with_rests([(40, 80), (140, 190), (230, 270)], 320, noise), 3.0)
    assert len(found) == 3
    np.testing.assert_allclose(found, [80, 190, 270], atol=4)


def test_what_always_or_never_rests_has_no_subtasks():
    assert subtasks.rests(np.zeros((100, 2)), 1.0) == []
    assert subtasks.rests(way_with_rests([(0, 100)], 100, 0.0), 1.0) == []
    # Nor does what only slows down.
    slows = np.interp(np.arange(100), [0, 40, 60, 100], [0.0, 0.44, 0.55, 1.0])[:, None]
    assert subtasks.rests(slows, 1.0) == []
    assert subtasks.rests(np.zeros((3, 2)), 1.0) == []


@pytest.mark.parametrize("noise", [0.0, 0.02, 0.1])
def test_change_points_are_where_a_profile_steps(noise):
    found = subtasks.change_points(steps([60, 150, 240], 300, noise))
    assert len(found) == 3
    np.testing.assert_allclose(found, [60, 150, 240], atol=2)


def test_a_profile_without_steps_has_no_change_points():
    assert subtasks.change_points(np.random.default_rng(0).normal(0, 0.1, 300)) == []
    assert subtasks.change_points(np.zeros(300)) == []
    assert subtasks.change_points(np.zeros(3)) == []


def test_uvd_finds_where_the_way_turns():
    # Out and back along a line, then off at a right angle: two turns.
    out = np.linspace(0, 1, 100)
    path = np.stack([np.concatenate([out, out[::-1], 0 * out]), np.concatenate([0 * out, 0 * out, out])], axis=1)
    found = subtasks.uvd(path)
    assert found and abs(found[0] - 100) <= 6
    assert subtasks.uvd(np.stack([out, 0 * out], axis=1)) == []


def test_true_boundaries_are_the_events_inside():
    assert subtasks.true_boundaries(np.array([40, -1, 10, 40, 0, 99]), 99) == [10, 40]


def test_f1_by_hand():
    # 100 frames, tolerance 2: 10 matches 12, 50 is missed, 70 and 71 compete for 70.
    assert subtasks.boundary_f1([12, 70, 71], [10, 50, 70], 100, 0.02) == pytest.approx(2 * 2 / 6)
    assert subtasks.boundary_f1([], [], 100, 0.02) == 1.0
    assert subtasks.boundary_f1([5], [], 100, 0.02) == 0.0 == subtasks.boundary_f1([], [5], 100, 0.02)


def test_covering_by_hand():
    # True subtasks of 40 and 60 frames; found ones of 50 and 50: overlaps 40 / 50 and 50 / 60.
    assert subtasks.covering([50], [40], 100) == pytest.approx(0.4 * 40 / 50 + 0.6 * 50 / 60)
    assert subtasks.covering([], [50], 100) == pytest.approx(0.5)


@settings(max_examples=50, deadline=None)
@given(st.sets(st.integers(1, 199), max_size=6), st.sets(st.integers(1, 199), max_size=6))
def test_measures_lie_between_0_and_1_and_are_1_for_the_truth(found, true):
    found, true = sorted(found), sorted(true)
    assert subtasks.boundary_f1(true, true, 200, 0.0) == 1.0
    assert subtasks.covering(true, true, 200) == pytest.approx(1.0)
    scores = [subtasks.boundary_f1(found, true, 200, tolerance) for tolerance in (0.0, 0.01, 0.05, 1.0)]
    assert scores == sorted(scores) and 0.0 <= scores[0] and scores[-1] <= 1.0
    assert 0.0 < subtasks.covering(found, true, 200) <= 1.0 + 1e-9


def test_judge_is_a_mean_over_episodes():
    judged = subtasks.judge([[50], []], [[50], [30]], np.array([100, 100]))
    assert judged["f1_at_1%"] == 0.5 and judged["found"] == 0.5 and judged["true"] == 1.0
    assert judged["covering"] == pytest.approx((1.0 + 0.3 * 0.3 + 0.7 * 0.7) / 2)


def test_subtasks_of_demonstrations_are_judged_by_their_events(monkeypatch):
    way = way_with_rests([(40, 80), (140, 190), (230, 270)], 320, 0.0)
    rewards = steps([60, 150, 240], 320, 0.02)
    monkeypatch.setattr(subtasks, "demonstration_embeddings", lambda *_: np.stack([way, way]))
    monkeypatch.setattr(subtasks, "demonstration_rewards", lambda *_: np.stack([rewards, rewards]))
    model: Any = SimpleNamespace(kappa=np.float32(1 / 3))
    plain = replace(demonstrations(2, 320), lengths=np.array([320, 200], np.int32))
    found = subtasks.demonstration_subtasks(model, plain, "rests")
    whole, cut = found["subtasks"]
    assert set(found) == {"subtasks"} and (whole["length"], cut["length"]) == (320, 200) and whole["kind"] is None
    np.testing.assert_allclose(whole["boundaries"], [80, 190, 270], atol=4)
    assert len(cut["boundaries"]) == 1 and whole["seconds"] == [frame / 8 for frame in whole["boundaries"]]
    labelled = replace(
        plain,
        events=np.array([[80, 190, 270], [80, -1, -1]], np.int32),
        event_names=("first", "second", "third"),
        kinds=np.array(["success", "failure"]),
    )
    found = subtasks.demonstration_subtasks(model, labelled, "rests")
    assert found["judged"]["f1_at_5%"] == 1.0 and found["judged"]["true"] == 2.0
    assert [row["kind"] for row in found["subtasks"]] == ["success", "failure"]
    stepped = subtasks.demonstration_subtasks(model, plain, "change_points")["subtasks"][0]["boundaries"]
    np.testing.assert_allclose(stepped, [60, 150, 240], atol=2)
    assert subtasks.demonstration_subtasks(model, plain, "uvd")["subtasks"][0]["boundaries"] == subtasks.uvd(way)
    with pytest.raises(ValueError, match="unknown method 'rest'; known methods: rests, change_points, uvd"):
        subtasks.demonstration_subtasks(model, plain, "rest")  # type: ignore[arg-type]
