"""Tracks between key frames: by hand arithmetic."""

import numpy as np
import pytest

from graphrl_jax.perception.detector import Detection
from graphrl_jax.perception.importers.key_frames import KeyFrame, by_frame, checked_length, track_boxes
from graphrl_jax.perception.importers.recording import ImportFailure


def key(frame, x=0.0, turn=0.0, seen=True, lasts=True):
    return KeyFrame(frame, np.array([x, 1.0, 2.0, 3.0, turn]), seen, lasts, f"frame {frame}")


def test_boxes_change_linearly_and_the_last_one_stays():
    found = track_boxes([key(5, 10.0), key(1, 2.0)], 8)
    assert {frame: box[0] for frame, box in found.items()} == {1: 2, 2: 4, 3: 6, 4: 8, 5: 10, 6: 10, 7: 10}
    np.testing.assert_array_equal([box[1:] for box in found.values()], [[1, 2, 3, 0]] * 7)


@pytest.mark.parametrize("before, after, middle", [(350, 10, 0), (10, 350, 0), (0, 90, 45), (-170, 170, 180)])
def test_boxes_turn_the_shorter_way(before, after, middle):
    turn = track_boxes([key(0, turn=before), key(2, turn=after)], 3)[1][4]
    assert (turn - middle) % 360 == 0


def test_absence_is_no_box():
    outside = track_boxes([key(0), key(2, seen=False, lasts=False), key(5)], 7)
    assert sorted(outside) == [0, 1, 5, 6]
    disabled = track_boxes([key(0, lasts=False), key(3), key(5, lasts=False)], 9)
    assert sorted(disabled) == [0, 3, 4, 5]
    assert track_boxes([], 3) == {}


def test_two_boxes_in_a_frame_are_refused():
    with pytest.raises(ImportFailure, match="^frame 1: the track has two boxes in this frame; allowed: one$"):
        track_boxes([key(1), key(0), key(1)], 3)


def test_detections_go_to_their_frames():
    one, two = (Detection(number, np.zeros(4, np.float32)) for number in (1, 2))
    assert by_frame([(2, one), (0, two), (2, two)], 4) == [[two], [], [one, two], []]
    assert checked_length(12.0, "size") == 12
    for length in (0, 1.5, 10**7):
        with pytest.raises(ImportFailure, match="size is .*; allowed: whole numbers from 1 to 500000"):
            checked_length(length, "size")
