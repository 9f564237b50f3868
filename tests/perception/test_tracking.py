"""Objects keep their slots, short gaps are bridged, long ones masked."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from graphrl_jax.graph import ObjectTable
from graphrl_jax.perception.detector import Detection
from graphrl_jax.perception.tracking import LONGEST_BRIDGE, Tracker, assign, track

OBJECTS = ObjectTable(
    names=("gripper", "left_shoe", "right_shoe"),
    class_ids=(0, 1, 1),
    is_robot=(True, False, False),
    class_names=("gripper", "shoe"),
)


def box(x, y=0.5):
    return np.array([x, y, 0.1, 0.1], np.float32)


def frame(*places, order=None):
    """Detections of the gripper and both shoes at these x; None is not seen."""
    seen = [Detection(min(slot, 1), box(x)) for slot, x in enumerate(places) if x is not None]
    return seen if order is None else [seen[index] for index in order]


@settings(max_examples=30, deadline=None)
@given(st.lists(st.permutations(range(3)), min_size=2, max_size=12))
def test_order_of_detections_does_not_matter(orders):
    frames = [frame(0.5, 0.2 + 0.01 * t, 0.7 - 0.01 * t, order=order) for t, order in enumerate(orders)]
    boxes, mask = track(frames, OBJECTS)
    assert mask.all()
    np.testing.assert_allclose(boxes[:, 1, 0], 0.2 + 0.01 * np.arange(len(orders)), atol=1e-6)
    np.testing.assert_allclose(boxes[:, 2, 0], 0.7 - 0.01 * np.arange(len(orders)), atol=1e-6)


def test_short_gaps_are_bridged_straight_and_long_ones_masked():
    gap, long = LONGEST_BRIDGE, LONGEST_BRIDGE + 1
    frames = [frame(0.1, 0.2, 0.8)] + [frame(0.1, None, 0.8)] * gap + [frame(0.1, 0.2 + 0.05 * (gap + 1), 0.8)]
    frames += [frame(None, 0.5, 0.8)] * long + [frame(0.1, 0.5, 0.8)]
    boxes, mask = track(frames, OBJECTS)
    np.testing.assert_allclose(boxes[: gap + 2, 1, 0], 0.2 + 0.05 * np.arange(gap + 2), atol=1e-6)
    assert mask[:, 1].all() and mask[:, 2].all()
    np.testing.assert_array_equal(mask[:, 0], [True] * (gap + 2) + [False] * long + [True])
    assert not boxes[~mask].any()


def test_an_object_that_returns_gets_its_slot_back():
    frames = [frame(0.5, 0.2, 0.8), frame(0.5, None, 0.8), frame(0.5, 0.25, 0.8), frame(0.5, 0.25, None)]
    boxes, mask = track(frames, OBJECTS)
    np.testing.assert_allclose(boxes[2, 1:, 0], [0.25, 0.8])
    np.testing.assert_array_equal(mask[3], [True, True, False])


def test_an_object_seen_late_is_not_taken_for_its_like():
    frames = [frame(0.5, 0.2, None), frame(0.5, 0.2, None), frame(0.5, None, 0.8), frame(0.5, 0.2, 0.8)]
    boxes, mask = track(frames, OBJECTS)
    np.testing.assert_allclose(boxes[:, 1, 0], 0.2)
    np.testing.assert_array_equal(mask[:, 2], [False, False, True, True])


def test_what_finds_no_slot_is_dropped():
    boxes, mask = track([[*frame(0.5, 0.2, 0.8), Detection(1, box(0.9)), Detection(0, box(0.1))]], OBJECTS)
    assert mask.all() and boxes[0, 1, 0] == pytest.approx(0.2)


def test_the_most_confident_detections_of_a_class_are_tracked():
    def shoes(*ranked):
        return [Detection(1, box(x), confidence) for x, confidence in ranked]

    frames = [shoes((0.1, 0.3), (0.7, 0.9), (0.4, 0.8)), shoes((0.4, 0.2), (0.9, 0.7), (0.1, 0.9)), shoes((0.1, 0.1))]
    boxes, mask = track(frames, OBJECTS)
    np.testing.assert_allclose(boxes[0, 1:, 0], [0.4, 0.7])
    np.testing.assert_allclose(sorted(boxes[1, 1:, 0]), [0.1, 0.9])
    assert mask[2].sum() == 1  # alone, an unsure detection counts


def test_a_box_that_is_listed_twice_counts_once():
    boxes, mask = track([[Detection(1, box(0.2)), Detection(1, box(0.2))]], OBJECTS)
    np.testing.assert_array_equal(mask, [[False, True, False]])


def test_nothing_at_all():
    boxes, mask = track([], OBJECTS)
    assert boxes.shape == (0, 3, 4) and mask.shape == (0, 3)
    assert not track([[], []], OBJECTS)[1].any()


def test_one_frame_after_the_other_is_tracked_as_all_at_once_and_gaps_hold_the_last_box():
    places = [0.2] + [None] * (LONGEST_BRIDGE + 1) + [0.3]
    frames = [frame(0.5, place, 0.7) for place in places]
    tracker, rows, held = Tracker(OBJECTS), [], []
    assert not tracker.held()[1].any()
    for detections in frames:
        rows.append(tracker.see(detections))
        held.append(tracker.held())
    np.testing.assert_array_equal(rows, assign(frames, OBJECTS))
    boxes, mask = (np.stack(values) for values in zip(*held, strict=True))
    assert mask[:, [0, 2]].all()
    np.testing.assert_array_equal(mask[:, 1], [True] * (LONGEST_BRIDGE + 1) + [False, True])
    np.testing.assert_allclose(boxes[:, 1, 0], [0.2] * (LONGEST_BRIDGE + 1) + [0.0, 0.3])
