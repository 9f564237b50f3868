"""Scores of recordings: curves by hand, stalls, and what a cut-off recording looks like."""

from dataclasses import replace

import numpy as np
import pytest

from graphrl_jax.reward import scoring
from graphrl_jax.reward.model import RewardModel, demonstration_rewards
from graphrl_jax.reward.scoring import Curve, at_times, score, summary
from tests.helpers.graphs import OBJECTS
from tests.helpers.reward_models import DEMOS, small_model


@pytest.fixture(scope="module")
def model() -> RewardModel:
    return small_model()


def test_a_curve_is_that_of_the_reward(model):
    length = int(DEMOS.lengths[0])
    boxes, mask = DEMOS.boxes[0, :length], DEMOS.mask[0, :length]
    curve = score(model, boxes, mask)
    np.testing.assert_allclose(curve.reward, demonstration_rewards(model, DEMOS)[0, :length], atol=1e-6)
    np.testing.assert_allclose(curve.reward, model.value(curve.distance), atol=1e-6)
    np.testing.assert_allclose(curve.progress, np.clip(1 + curve.reward, 0, 1))
    np.testing.assert_array_equal(curve.found, mask)
    assert curve.subtask[0] == 0 and (np.diff(curve.subtask) >= 0).all()
    assert not curve.active[0].any() and (np.diff(curve.active.astype(int), axis=0) >= 0).all()


def curve_of(progress: np.ndarray, subtask: np.ndarray | None = None) -> Curve:
    progress = np.asarray(progress, np.float32)
    flags = np.ones((len(progress), 4), bool)
    flags[::2, 1] = False
    subtask = np.zeros(len(progress), np.int64) if subtask is None else subtask
    return Curve(1 - progress, progress - 1, progress, subtask, flags, flags, len(progress) - 1)


def test_a_steady_recording_does_not_stall_and_looks_like_success(model):
    found = summary(model, curve_of(np.linspace(0, 0.95, 41), np.repeat([0, 1, 2], [10, 20, 11])))
    assert (found["frames"], found["seconds"], found["stalls"]) == (41, 41 / 8, [])
    assert found["looks_like_success"] and found["value_order_correlation"] == pytest.approx(1)
    assert found["final_progress"] == pytest.approx(0.95) and found["subtasks"] == [10, 30]
    assert found["coverage"] == {"robot": 1, "block": pytest.approx(20 / 41, abs=1e-4), "region": 1, "absent": 1}
    assert found["unseen_at_end"] == ["block"]


def test_the_order_is_also_judged_without_the_rest_at_the_end(model):
    rising = curve_of(np.concatenate([np.linspace(0, 0.9, 10), np.full(10, 0.8)]))
    found = summary(model, rising._replace(rest=9))
    assert found["value_order_before_rest"] == pytest.approx(1) and found["rest"] == pytest.approx(9 / 8)
    assert found["value_order_correlation"] == summary(model, rising)["value_order_before_rest"] < 0.9


def test_rest_begins_when_the_last_object_but_the_robot_stands_still(model):
    boxes = np.tile(np.array([[0.2, 0.2, 0.1, 0.1]], np.float32), (12, OBJECTS.num_slots, 1))
    mask = np.ones(boxes.shape[:2], bool)
    assert score(model, boxes, mask).rest == 0
    boxes[:, OBJECTS.names.index("robot"), 0] = np.linspace(0.1, 0.9, 12)
    assert score(model, boxes, mask).rest == 0
    boxes[:, OBJECTS.names.index("block"), 0] = np.minimum(np.linspace(0.1, 0.9, 12), 0.5)
    assert score(model, boxes, mask).rest == np.flatnonzero(np.linspace(0.1, 0.9, 12) > 0.5)[0]


def test_where_only_the_robot_moves_there_are_no_subtasks(model, monkeypatch):
    monkeypatch.setattr(scoring, "rests", lambda *_: [4, 8])
    boxes = np.tile(np.array([[0.2, 0.2, 0.1, 0.1]], np.float32), (12, OBJECTS.num_slots, 1))
    mask = np.ones(boxes.shape[:2], bool)
    boxes[:, OBJECTS.names.index("robot"), 0] = np.linspace(0.1, 0.9, 12)
    assert not score(model, boxes, mask).subtask.any()
    boxes[6:, OBJECTS.names.index("block"), 0] = 0.5
    np.testing.assert_array_equal(score(model, boxes, mask).subtask, np.repeat([0, 1, 2], 4))


def test_a_recording_that_is_cut_off_does_not_look_like_success(model):
    assert not summary(model, curve_of(np.linspace(0, 0.95, 41)[:20]))["looks_like_success"]
    assert not summary(model, curve_of(np.linspace(0, 0.89, 41)))["looks_like_success"]


def test_stalls_are_spans_without_a_gain(model):
    # Half a second up, three seconds still, up again, and still at the goal, which is no stall.
    progress = np.concatenate([np.linspace(0, 0.4, 5), np.full(24, 0.4), np.linspace(0.5, 1, 5), np.full(40, 1.0)])
    assert summary(model, curve_of(progress))["stalls"] == [(0.5, 29 / 8)]
    unfinished = np.concatenate([np.linspace(0, 0.4, 5), np.full(24, 0.4)])
    assert summary(model, curve_of(unfinished))["stalls"] == [(0.5, 29 / 8)]


def test_a_recording_that_ends_as_a_success_does_not_stall_after_it_first_looked_so(model):
    # Finished below 1, and a little lower again as the hand leaves.
    done = np.concatenate([np.linspace(0, 0.95, 9), np.full(24, 0.93)])
    assert summary(model, curve_of(done))["stalls"] == []
    late = np.concatenate([np.linspace(0, 0.4, 5), np.full(24, 0.4), [0.95], np.full(24, 0.93)])
    assert summary(model, curve_of(late))["stalls"] == [(0.5, 29 / 8)]
    undone = np.concatenate([np.linspace(0, 0.95, 9), np.full(24, 0.5)])
    assert summary(model, curve_of(undone))["stalls"] == [(1.0, 33 / 8)]


def test_a_curve_at_other_times_is_interpolated():
    curve = curve_of(np.array([0.0, 0.4, 0.8]), np.array([0, 0, 1]))._replace(rest=2)
    found = at_times(curve, 2.0, np.array([0.0, 0.25, 0.5, 0.8, 1.0, 1.4]))
    np.testing.assert_allclose(found.progress, [0, 0.2, 0.4, 0.64, 0.8, 0.8], atol=1e-6)
    np.testing.assert_allclose(found.distance, 1 - found.progress, atol=1e-6)
    assert found.subtask.tolist() == [0, 0, 0, 1, 1, 1] and found.rest == 4
    assert found.found[:, 1].tolist() == [False, False, True, False, False, False]


def test_a_model_without_card_scores_nothing(model):
    with pytest.raises(ValueError, match="need a reward model of graphs with a card"):
        score(replace(model, card=None), DEMOS.boxes[0], DEMOS.mask[0])
    with pytest.raises(ValueError, match="needs a reward model with a card"):
        summary(replace(model, card=None), curve_of(np.ones(3)))
