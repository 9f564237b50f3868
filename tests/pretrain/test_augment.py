"""Rearranged demonstrations: what must stay, what must vary, and how the way to go falls."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from graphrl_jax.graph import ObjectTable, activity
from graphrl_jax.pretrain.augment import Chances, Motion, motion, rearrange

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
    active=jnp.zeros((2, 6), bool),
    moved=jnp.asarray(MOVED),
    first=jnp.asarray(START, jnp.float32),
    last=jnp.asarray(END, jnp.float32),
    begin=jnp.array([100.0, 0.0, 60.0, 20.0, 100.0, 100.0]),
    track=jnp.zeros((2, 6, 4)),
)
TOTAL = np.linalg.norm(END[2:4, :2] - START[2:4, :2], axis=-1).sum()
TIMES = np.linspace(0, 1, 201, dtype=np.float32)
NUM = 64
APPROACH = 0.2


@jax.jit
def many(
    bumped: float, before: float, motion: Motion, in_order: float = 0.0, tau: float = 0.0
) -> tuple[jax.Array, jax.Array]:
    keys = jax.random.split(jax.random.key(0), NUM)
    chances = Chances(bumped, before, APPROACH, in_order, tau)
    return jax.vmap(lambda key: rearrange(key, OBJECTS, motion, TIMES, chances))(keys)


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


def test_the_demonstrated_order_is_kept_as_often_as_asked_for():
    for in_order, share in ((1.0, (1.0, 1.0)), (0.5, (0.6, 0.9))):
        boxes, _ = many(0.0, 0.0, MOTION, in_order)
        first, second = (_steps(np.asarray(boxes), slot) > 1e-5 for slot in (FIRST, SECOND))
        assert share[0] <= (second.argmax(1) < first.argmax(1)).mean() <= share[1]
        # With both trips of an object before the other's.
        apart = first.shape[1] - 1 - second[:, ::-1].argmax(1) <= first.argmax(1)
        assert share[0] - 0.2 <= apart.mean() and (in_order < 1 or apart.all())


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


def test_activity_is_that_of_the_sequence_which_is_returned(rearranged):
    found, flags = many(0.5, 0.0, MOTION, 0.5, 0.15)
    np.testing.assert_array_equal(flags, ACTIVITY(found, np.ones(found.shape[:3], bool), 0.15))
    # From frames that begin late: compared with the first place all the same, the robot's too.
    late = slice(4, None, 10)
    boxes, active = some_frames(TIMES[late])
    np.testing.assert_allclose(boxes, found[:, late], atol=1e-6)
    away = np.linalg.norm(found[:, late, :, :2] - found[:, :1, :, :2], axis=-1)
    beyond = np.logical_or.accumulate(away > 0.15 * np.linalg.norm(found[:, late, :, 2:], axis=-1), axis=1)
    np.testing.assert_array_equal(active, beyond)
    assert active[:, 0, ROBOT].any() and not active[:, 0, ROBOT].all()


ACTIVITY = jax.jit(jax.vmap(activity, in_axes=(0, 0, None)))


@jax.jit
def some_frames(times: jax.Array) -> tuple[jax.Array, jax.Array]:
    keys = jax.random.split(jax.random.key(0), NUM)
    chances = Chances(bumped=0.5, bumped_before=0.0, approach=APPROACH, in_order=0.5, tau=0.15)
    return jax.vmap(lambda key: rearrange(key, OBJECTS, MOTION, times, chances))(keys)


def test_without_articulated_objects_nothing_is_lifted(rearranged):
    boxes, _ = rearranged
    start, way = (boxes[:, at, FIRST : SECOND + 1, :2] for at in (0, -1))
    way = way - start
    gone = boxes[:, :, FIRST : SECOND + 1, :2] - start[:, None]
    beside = gone[..., 0] * way[:, None, :, 1] - gone[..., 1] * way[:, None, :, 0]
    np.testing.assert_allclose(beside, 0.0, atol=1e-6)


# A lid that swings open, and two things that are put into the crate below it.
LID, CUP, PEN, CRATE, HAND = range(5)
ROOM = ObjectTable(
    names=("lid", "cup", "pen", "crate", "hand"),
    class_ids=(0, 1, 1, 2, 3),
    is_robot=(False, False, False, False, True),
    class_names=("lid", "thing", "crate", "hand"),
    is_fixture=(False, False, False, True, False),
    is_articulated=(True, False, False, False, False),
)
_ANGLES = np.linspace(0, np.pi / 2, 48)
SWING = np.stack(
    [
        0.25 + 0.15 * np.cos(_ANGLES),
        0.5 - 0.15 * np.sin(_ANGLES),
        0.05 + 0.3 * np.cos(_ANGLES),
        0.05 + 0.3 * np.sin(_ANGLES),
    ],
    axis=1,
)
ROOM_MOTION = Motion(
    active=jnp.zeros((2, 5), bool),
    moved=jnp.array([True, True, True, False, True]),
    first=jnp.array(
        [SWING[0], [0.2, 0.8, 0.1, 0.1], [0.8, 0.7, 0.1, 0.1], [0.4, 0.5, 0.3, 0.2], [0.5] * 2 + [0.1] * 2]
    ),
    last=jnp.array(
        [SWING[-1], [0.45, 0.5, 0.1, 0.1], [0.35, 0.52, 0.1, 0.1], [0.4, 0.5, 0.3, 0.2], [0.6] * 2 + [0.1] * 2]
    ),
    begin=jnp.array([10.0, 50.0, 90.0, 120.0, 0.0]),
    track=jnp.zeros((48, 5, 4)).at[:, LID].set(SWING),
)
EVENLY = Chances(bumped=0.0, bumped_before=0.0, approach=0.0, in_order=1.0, tau=0.15)


@jax.jit
def rooms(chances: Chances, motion: Motion = ROOM_MOTION) -> tuple[jax.Array, jax.Array]:
    keys = jax.random.split(jax.random.key(1), NUM)
    return jax.vmap(lambda key: rearrange(key, ROOM, motion, TIMES, chances))(keys)


def set_off(boxes: np.ndarray) -> np.ndarray:
    """Frame in which the lid, the cup and the pen begin to move: (NUM, 3)."""
    moves = np.abs(np.diff(boxes[:, :, [LID, CUP, PEN]], axis=1)).max(-1) > 1e-5
    assert moves.any(axis=1).all()
    return moves.argmax(axis=1)


def test_an_articulated_object_goes_along_its_own_track_from_end_to_end():
    boxes = np.asarray(rooms(Chances(0.2, 0.5, 0.15, 0.5, 0.15))[0])[:, :, LID]
    np.testing.assert_allclose(boxes[:, 0], np.tile(SWING[0], (NUM, 1)), atol=1e-6)
    np.testing.assert_allclose(boxes[:, -1], np.tile(SWING[-1], (NUM, 1)), atol=1e-6)
    ways = np.diff(SWING, axis=0)
    offsets = boxes[:, :, None] - SWING[:-1]
    share = np.clip((offsets * ways).sum(-1) / (ways**2).sum(-1), 0, 1)
    gaps = np.linalg.norm(offsets - share[..., None] * ways, axis=-1)
    assert gaps.min(-1).max() < 1e-6
    between = gaps.argmin(-1)
    place = between + np.take_along_axis(share, between[..., None], -1)[..., 0]
    assert np.diff(place, axis=1).min() > -1e-3 and np.ptp(place, axis=1).min() > 46.9


def test_with_an_articulated_object_every_object_takes_the_same_time():
    boxes = np.asarray(rooms(EVENLY)[0])
    # Three objects, each a third of the time, however far it has to go.
    swing = np.stack([np.interp(np.clip(3 * TIMES, 0, 1) * 47, np.arange(48), SWING[:, i]) for i in range(4)], axis=1)
    np.testing.assert_allclose(boxes[:, :, LID], np.tile(swing, (NUM, 1, 1)), atol=1e-5)
    for job, slot in ((1, CUP), (2, PEN)):
        across = boxes[:, :, slot, 0]  # upwards it may be lifted
        share = (across - across[:, :1]) / (across[:, -1:] - across[:, :1])
        share = share[np.abs(across[:, -1] - across[:, 0]) > 0.05]
        time = 3 * TIMES - job
        np.testing.assert_allclose(share[:, time <= 0], 0.0, atol=1e-3)
        np.testing.assert_allclose(share[:, time >= 1], 1.0, atol=1e-3)
        under_way = share[:, (time > 0.02) & (time < 0.98)]
        assert under_way.min() > 0 and under_way.max() < 1 and np.diff(share, axis=1).min() > -1e-3
        # It slows down towards its end.
        assert under_way.mean() > 0.53
    ways = np.linalg.norm(boxes[:, -1, CUP, :2] - boxes[:, 0, CUP, :2], axis=-1)
    assert ways.min() < 0.2 and ways.max() > 0.45


@pytest.mark.parametrize("begin", list(itertools.permutations((10.0, 50.0, 90.0))))
def test_rearrangements_in_order_keep_the_demonstrated_order(begin):
    motion = ROOM_MOTION._replace(begin=jnp.array([*begin, 120.0, 0.0]))
    boxes = np.asarray(rooms(EVENLY, motion)[0])
    np.testing.assert_array_equal(set_off(boxes).argsort(axis=1), np.tile(np.argsort(begin), (NUM, 1)))


def test_rearrangements_out_of_order_have_every_order():
    orders = set_off(np.asarray(rooms(EVENLY._replace(in_order=0.0))[0])).argsort(axis=1)
    assert len(np.unique(orders, axis=0)) == 6
    kept = set_off(np.asarray(rooms(EVENLY._replace(in_order=0.5))[0])).argsort(axis=1)
    assert 0.4 < (kept == [0, 1, 2]).all(axis=1).mean() < 0.8  # a half, and a sixth of the others


def test_with_an_articulated_object_others_end_where_they_did_and_start_there_or_anywhere():
    boxes = np.asarray(rooms(EVENLY)[0])
    things = [CUP, PEN]
    np.testing.assert_allclose(boxes[:, -1, things], np.tile(ROOM_MOTION.last[1:3], (NUM, 1, 1)), atol=1e-6)
    home = np.abs(boxes[:, 0, things] - np.asarray(ROOM_MOTION.first[1:3])).max(-1) < 1e-6
    assert 0.2 < home.mean() < 0.5  # 0.35 is asked for
    assert boxes[:, 0, things, :2][~home].std(axis=0).min() > 0.15


def test_with_an_articulated_object_others_are_often_lifted_on_their_way():
    boxes = np.asarray(rooms(EVENLY)[0])
    heights = []
    for job, slot in ((1, CUP), (2, PEN)):
        start, end = boxes[:, :1, slot, :2], boxes[:, -1:, slot, :2]
        far = np.abs(end - start)[:, 0, 0] > 0.05
        across, y = np.moveaxis(boxes[far, :, slot, :2] - start[far], -1, 0)
        height = across / (end - start)[far, :, 0] * (end - start)[far, :, 1] - y
        at_rest = (3 * TIMES <= job) | (3 * TIMES >= job + 1)
        np.testing.assert_allclose(height[:, at_rest], 0.0, atol=1e-4)
        heights.append(height)
    heights = np.concatenate(heights)
    assert heights.min() > -1e-4 and heights.max() < 0.18 + 1e-4
    highest = heights.max(axis=1)
    # Half of the trips, and one trip of two in half of the cases.
    assert 0.4 < (highest > 0.01).mean() < 0.8 and np.max(highest) > 0.14


def test_activity_with_an_articulated_object_is_that_of_the_sequence_which_is_returned():
    boxes, active = map(np.asarray, rooms(Chances(0.5, 0.0, 0.15, 0.5, 0.15)))
    np.testing.assert_array_equal(active, ACTIVITY(boxes, np.ones(boxes.shape[:3], bool), 0.15))
    assert active[:, -1, LID].all() and not active[:, :, CRATE].any()


def test_an_articulated_object_that_was_never_moved_stays_and_the_others_move():
    motion = ROOM_MOTION._replace(moved=ROOM_MOTION.moved.at[LID].set(False))
    boxes, active = map(np.asarray, rooms(Chances(1.0, 1.0, 0.0, 1.0, 0.15), motion))
    np.testing.assert_allclose(boxes[:, :, LID], np.broadcast_to(SWING[0], (NUM, TIMES.size, 4)), atol=1e-6)
    # A start may be within tau of the end.
    assert not active[:, :, LID].any() and active[:, -1, [CUP, PEN]].mean() > 0.95
    # Two objects, each half of the time.
    for slot, rests in ((CUP, TIMES >= 0.5), (PEN, TIMES <= 0.5)):
        still = boxes[:, rests, slot]
        np.testing.assert_allclose(still, np.broadcast_to(still[:, :1], still.shape), atol=1e-5)


def swings(creep: float) -> tuple[np.ndarray, np.ndarray]:
    """Boxes (22, 5, 4) and mask: the lid creeps along x, in frames 5 to 14 it goes by 0.04 each, and rests."""
    boxes = np.tile(np.array([0.2, 0.5, 0.1, 0.1], np.float32), (22, 5, 1))
    boxes[:, LID, 0] += 0.04 * np.clip(np.arange(22) - 4, 0, 10) + creep * np.minimum(np.arange(22), 15)
    return boxes, np.ones((22, 5), bool)


def test_a_track_is_the_demonstrations_from_where_an_object_sets_off_to_where_it_arrives():
    boxes, mask = swings(creep=0.0)
    mask[9, LID] = False
    boxes[9, LID], boxes[20:] = 9.0, 9.0  # seen by nobody, and padding
    found = jax.jit(motion)(boxes, mask, 20, 1.0)
    # Half of tau diagonals is 0.0707. In frame 5 the lid is 0.04 from its first place, in frame 13 from its last one.
    np.testing.assert_array_equal(found.begin, [5, 19, 19, 19, 19])
    track = np.asarray(found.track[:, LID])
    np.testing.assert_array_equal(track[0], boxes[0, LID])
    np.testing.assert_array_equal(track[-1], boxes[19, LID])
    shown = [frame for frame in range(4, 15) if frame != 9]
    np.testing.assert_allclose(np.unique(track[:, 0]), boxes[shown, LID, 0], atol=1e-7)
    assert (np.diff(track[:, 0]) >= 0).all()
    # Equal intervals of time, 48 boxes from 4.2 to 13.8 rounded to frames, are some five boxes for each frame.
    counts = np.unique(track[:, 0], return_counts=True)[1]
    assert counts[1:-1].min() >= 4 and counts[1:-1].max() <= 2 * 6
    np.testing.assert_array_equal(found.track[:, CUP], np.broadcast_to(boxes[0, CUP], track.shape))


def test_what_has_hardly_stirred_before_it_is_brought_is_not_active_from_the_start():
    boxes, mask = swings(creep=0.001)
    found = jax.jit(motion)(boxes, mask, 22, 0.02)
    returned, active = map(np.asarray, rooms(Chances(0.0, 0.0, 0.0, 1.0, 0.0), found))
    assert not active[:, 0, LID].any() and active[:, 10:, LID].all()
    np.testing.assert_allclose(returned[:, 0, LID], np.tile(boxes[0, LID], (NUM, 1)), atol=1e-6)
    np.testing.assert_allclose(returned[:, -1, LID], np.tile(boxes[-1, LID], (NUM, 1)), atol=1e-6)
