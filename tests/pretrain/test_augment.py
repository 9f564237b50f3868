"""Rearranged demonstrations: what must stay, what must vary, and how the way to go falls."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from graphrl_jax.graph import ObjectTable
from graphrl_jax.pretrain.augment import Motion, motion, rearrange

OBJECTS = ObjectTable(
    names=("region", "robot", "first", "second", "bystander", "spot"),
    class_ids=(0, 1, 2, 2, 2, 0),
    is_robot=(False, True, False, False, False, False),
    class_names=("region", "robot", "block"),
    is_fixture=(True, False, False, False, False, True),
)
REGION, ROBOT, FIRST, SECOND, BYSTANDER = range(5)
# The first block ends in the region, the second on a spot that is only a point.
START = np.array(
    [
        [0.5, 0.5, 0.2, 0.3],
        [0.2, 0.2, 0.2, 0.2],
        [0.4, 0.3, 0.1, 0.1],
        [0.6, 0.8, 0.1, 0.1],
        [0.3, 0.7, 0.1, 0.1],
        [0.65, 0.7, 0.0, 0.0],
    ]
)
END = np.array(
    [
        [0.5, 0.5, 0.2, 0.3],
        [0.6, 0.4, 0.2, 0.2],
        [0.5, 0.45, 0.1, 0.1],
        [0.65, 0.7, 0.12, 0.1],
        [0.3, 0.7, 0.1, 0.1],
        [0.65, 0.7, 0.0, 0.0],
    ]
)
MOVED = np.array([False, True, True, True, False, False])
MOTION = Motion(
    jnp.zeros((2, 6), bool), jnp.asarray(MOVED), jnp.asarray(START, jnp.float32), jnp.asarray(END, jnp.float32)
)
TOTAL = np.linalg.norm(END[2:4, :2] - START[2:4, :2], axis=-1).sum()
TIMES = np.linspace(0, 1, 201, dtype=np.float32)
NUM = 64
APPROACH = 0.2


@jax.jit
def many(bumped: float, before: float, motion: Motion) -> tuple[jax.Array, jax.Array]:
    keys = jax.random.split(jax.random.key(0), NUM)
    return jax.vmap(lambda key: rearrange(key, OBJECTS, motion, TIMES, bumped, before, APPROACH))(keys)


@pytest.fixture(scope="module")
def rearranged() -> tuple[np.ndarray, np.ndarray]:
    boxes, active = many(0.0, 0.0, MOTION)
    return np.asarray(boxes), np.asarray(active)


def test_fixtures_stay_and_goals_are_kept(rearranged):
    boxes, active = rearranged
    np.testing.assert_array_equal(boxes[:, :, REGION], np.broadcast_to(MOTION.first[REGION], (NUM, TIMES.size, 4)))
    assert not active[:, :, REGION].any()
    np.testing.assert_allclose(boxes[:, -1, SECOND], np.broadcast_to(MOTION.last[SECOND], (NUM, 4)), atol=1e-6)
    inside = np.abs(boxes[:, -1, FIRST, :2] - START[REGION, :2]) <= START[REGION, 2:] / 2
    assert inside.all() and (boxes[:, -1, FIRST, :2].std(axis=0) > 0.03).all()


def test_the_way_to_go_is_the_demonstrations_dealt_out_anew(rearranged):
    centres = rearranged[0][:, :, [FIRST, SECOND], :2]
    ways = np.linalg.norm(centres[:, 0] - centres[:, -1], axis=-1)
    # So short a way is never cut by the image's border.
    np.testing.assert_allclose(ways.sum(-1), TOTAL, rtol=1e-4)
    assert (ways[:, 0] / TOTAL).min() < 0.2 and (ways[:, 0] / TOTAL).max() > 0.8


def _steps(boxes: np.ndarray, slot: int) -> np.ndarray:
    """How far an object goes from frame to frame, (NUM, frames - 1)."""
    return np.linalg.norm(np.diff(boxes[:, :, slot, :2], axis=1), axis=-1)


def test_one_robot_brings_one_object_after_the_other_and_holds_on_to_it(rearranged):
    boxes, _ = rearranged
    first, second = (_steps(boxes, slot) > 1e-5 for slot in (FIRST, SECOND))
    # Both only in a frame in which one is put down and the other picked up.
    assert (first & second).sum(1).max() <= 3 and (first & second).mean() < 0.03
    for slot, moves in ((FIRST, first), (SECOND, second)):
        whole = moves[:, :-1] & moves[:, 1:]
        gap = np.linalg.norm(boxes[:, 1:-1, ROBOT, :2] - boxes[:, 1:-1, slot, :2], axis=-1)[whole]
        reach = (0.2 + END[slot, 2:].max()) / 2
        # A robot beside an object at the image's border is pushed into the image.
        assert np.quantile(gap, 0.1) > 0.59 * reach and gap.max() < 1.01 * reach


def test_objects_go_in_any_order_and_some_in_two_trips(rearranged):
    first, second = (_steps(rearranged[0], slot) > 1e-5 for slot in (FIRST, SECOND))
    assert 0.2 < (first.argmax(1) < second.argmax(1)).mean() < 0.8
    trips = (np.diff(np.pad(first, ((0, 0), (1, 1))).astype(int), axis=1) == 1).sum(1)
    assert {1, 2} == set(trips.tolist())


def test_time_falls_evenly_on_ways_with_an_object_and_faster_without(rearranged):
    boxes, _ = rearranged
    carried = _steps(boxes, FIRST) + _steps(boxes, SECOND)
    whole = np.pad(carried[:, 1:-1] > 1e-5, ((0, 0), (1, 1))) & (np.roll(carried, 1, 1) > 1e-5)
    whole &= np.roll(carried, -1, 1) > 1e-5
    speed = np.nanmedian(np.where(whole, carried, np.nan), axis=1, keepdims=True)
    assert (np.abs(carried - speed)[whole] < 0.02 * np.broadcast_to(speed, carried.shape)[whole]).mean() > 0.95
    alone = _steps(boxes, ROBOT)[carried < 1e-6]
    fast = np.broadcast_to(speed / APPROACH, carried.shape)[carried < 1e-6]
    assert np.quantile(np.abs(alone - fast) / fast, 0.6) < 0.02


def test_objects_become_active_when_they_set_off_and_stay_so(rearranged):
    boxes, active = rearranged
    assert (np.diff(active.astype(int), axis=1) >= 0).all()
    away = np.abs(boxes[..., :2] - boxes[:, :1, :, :2]).max(-1) > 1e-4
    assert active[away].all() and active[:, -1, [FIRST, SECOND]].all() and not active[:, 0].any()


def test_what_was_never_moved_lies_anywhere_and_is_bumped_on_request(rearranged):
    boxes, active = rearranged
    still = boxes[:, :, BYSTANDER]
    np.testing.assert_array_equal(still, np.broadcast_to(still[:, :1], still.shape))
    assert not active[:, :, BYSTANDER].any() and (still[:, 0, :2].std(axis=0) > 0.15).all()
    bumped_boxes, bumped = map(np.asarray, many(1.0, 0.0, MOTION))
    # A move of its own may begin after the last object has arrived, and then is not seen.
    assert bumped[:, -1, BYSTANDER].mean() > 0.6
    went = np.abs(bumped_boxes[:, -1] - bumped_boxes[:, 0])[:, BYSTANDER].max(-1) > 0
    np.testing.assert_array_equal(went, bumped[:, -1, BYSTANDER])


def test_what_was_bumped_before_counts_as_moved_throughout_and_only_if_never_carried(rearranged):
    boxes, active = map(np.asarray, many(0.0, 0.5, MOTION))
    np.testing.assert_allclose(boxes, rearranged[0], atol=1e-6)
    slots = [slot for slot in range(5) if slot != BYSTANDER]
    np.testing.assert_array_equal(active[..., slots], rearranged[1][..., slots])
    before = active[:, 0, BYSTANDER]
    assert 0.25 < before.mean() < 0.75
    np.testing.assert_array_equal(active[..., BYSTANDER], np.broadcast_to(before[:, None], active.shape[:2]))


def test_what_was_moved_but_left_outside_counts_as_bumped():
    left = MOTION._replace(moved=MOTION.moved.at[BYSTANDER].set(True), last=MOTION.last.at[BYSTANDER, 0].add(0.1))
    boxes, active = map(np.asarray, many(0.0, 0.0, left))
    assert not active[:, :, BYSTANDER].any() and np.ptp(boxes[:, -1, BYSTANDER, :2], axis=0).min() > 0.5
    assert active[:, -1, FIRST].all() and active[:, -1, SECOND].all()
    # Where nothing ends in a fixture, whatever was moved was brought there.
    away = left._replace(last=left.last.at[jnp.array([FIRST, SECOND]), 1].add(0.25))
    boxes, active = map(np.asarray, many(0.0, 0.0, away))
    assert active[:, -1, FIRST : BYSTANDER + 1].all()
    np.testing.assert_allclose(boxes[:, -1, BYSTANDER], np.broadcast_to(away.last[BYSTANDER], (NUM, 4)), atol=1e-6)


def test_the_robot_starts_anywhere(rearranged):
    assert (rearranged[0][:, 0, ROBOT, :2].std(axis=0) > 0.15).all()


def test_where_nothing_was_moved_the_robot_stays():
    still = MOTION._replace(moved=jnp.zeros(6, bool))
    boxes, active = map(np.asarray, many(0.0, 0.0, still))
    assert np.isfinite(boxes).all() and not active[:, :, [FIRST, SECOND, BYSTANDER]].any()
    places = boxes[:, :, ROBOT, :2]
    np.testing.assert_array_equal(places, np.broadcast_to(places[:, :1], places.shape))


def test_motion_skips_frames_without_the_object_and_padding():
    boxes = (np.arange(5)[:, None, None] * np.array([0.0, 0.1])[:, None] + np.full((5, 2, 4), 0.2)).astype(np.float32)
    mask = np.array([[True, False], [True, True], [True, True], [True, False], [True, True]])
    found = jax.jit(motion)(boxes, mask, 4, 0.01)
    np.testing.assert_array_equal(found.moved, [False, True])
    np.testing.assert_array_equal(found.first[1], boxes[1, 1])
    np.testing.assert_array_equal(found.last[1], boxes[2, 1])
