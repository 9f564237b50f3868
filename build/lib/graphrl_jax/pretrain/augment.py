"""Rearranged demonstrations: the same objects brought to the same places, from other places and in another order.

Demonstrations of a task start and proceed alike, so an encoder trained on them alone is meaningless in other states. A
policy visits those. A rearrangement keeps what a video shows of the goal, the ends of objects, and redraws the rest:

- Every moved object starts elsewhere and moves straight to its end. An object that ends inside a fixture's box may end
  anywhere well inside it. The summed distance of these objects is that of the original (less if the image's border cuts
  it).
- The robot starts anywhere and brings one object after the other, in any order. It may put an object down on its way
  and return for it. Time is proportional to the distance over which objects are brought. The robot's way to the next
  object takes a fraction of that time, enough to show the order and too little to outweigh objects.
- An object that was never moved lies anywhere. It is sometimes bumped to another place, before or during the
  demonstration, so that neither its place nor its activity shows progress (an encoder that never saw earlier bumps
  rewarded bumping itself, by a tenth of the way). If some objects were brought into a fixture, a moved object outside
  it is treated in the same way: people bump into things, and an encoder that took bumps for progress rewarded them.
- Fixtures (`ObjectTable.is_fixture`) stay.
- An articulated object (`ObjectTable.is_articulated`), such as a lid, replays its demonstrated track. Its way cannot
  be compared with that of a free object, so every object takes the same time then. Free objects start where they did
  or anywhere in the image. They end where they did: such a scene is seen in perspective, in which not every place
  inside the fixture's box is inside the fixture. They are often lifted on their way.
- With probability `in_order` objects are brought in the demonstrated order, whose states are physically possible; else
  in any order, so that no order is taken for progress.

A rearrangement needs boxes, activity and time only. It is not from a paper.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike

from graphrl_jax.graph import ObjectTable, activity, safe_norm

# Least distance of centres from the image's border, in image sides.
_MARGIN = 0.08
# Least distance of ends inside a fixture's box from its border, as a share of its side. If objects end at the border,
# the reward hardly falls across it, and policies leave objects outside.
INSET = 0.2
# Probability that an object is put down on its way.
_PUT_DOWN = 0.5
# Range of the distance between the centres of the robot and the object it brings, in units of half their summed sizes.
_GRIP = (0.6, 1.0)
# Shortest duration of a bump, as a share of the demonstration.
_SHORTEST_BUMP = 0.15
_DIRECTIONS = 16
# With articulated objects: probability that a free object starts where it did, and the largest height to which
# it is lifted on half of its trips, in image sides.
_AT_HOME = 0.35
_MOST_LIFTED = 0.18
# With articulated objects: exponent by which a free object slows down towards its end. At constant speed, what is held
# above its place would be as good as put down.
_SLOWING = 1.5
# Least distance from its start at which an object has moved, in image sides: more than rounding, if tau is 0.
_LEAST_MOVED = 1e-5
# Number of boxes along an articulated object's track.
_TRACK = 48


class Motion(NamedTuple):
    """How the objects move in one demonstration.

    | field  | shape     | dtype   | meaning                                                            |
    |--------|-----------|---------|--------------------------------------------------------------------|
    | active | (T, N)    | bool    | activity at the full frame rate                                    |
    | moved  | (N,)      | bool    | activity in any frame                                              |
    | first  | (N, 4)    | float32 | box in the first frame that has the object                         |
    | last   | (N, 4)    | float32 | box in the last frame that has the object                          |
    | begin  | (N,)      | float32 | frame in which the object begins to move; the last if it never does |
    | track  | (K, N, 4) | float32 | boxes at K equal intervals of time from then until it has arrived, |
    |        |           |         | the first and the last one included                                |
    """

    active: jax.Array
    moved: jax.Array
    first: jax.Array
    last: jax.Array
    begin: jax.Array
    track: jax.Array


class Chances(NamedTuple):
    """How rearrangements are drawn; all () float32.

    | field         | meaning                                                                               |
    |---------------|---------------------------------------------------------------------------------------|
    | bumped        | probability that an object that is not brought is bumped                              |
    | bumped_before | probability that such an object counts as moved from the first frame on               |
    | approach      | time of the robot's way to an object, relative to bringing an object as far           |
    | in_order      | probability of the demonstrated order                                                 |
    | tau           | distance from the start at which an object becomes active, in its box's diagonals     |
    """

    bumped: ArrayLike
    bumped_before: ArrayLike
    approach: ArrayLike
    in_order: ArrayLike
    tau: ArrayLike


def motion(boxes: jax.Array, mask: jax.Array, length: ArrayLike, tau: ArrayLike, rule: str = "displacement") -> Motion:
    """`Motion` of a padded demonstration: boxes (T, N, 4), mask (T, N), length (); tau and rule: `update_activity`."""
    frames = jnp.arange(boxes.shape[0])[:, None]
    mask = mask & (frames < length)
    active = activity(boxes, mask, tau, rule)
    slots = jnp.arange(boxes.shape[1])
    first = boxes[jnp.argmax(mask, axis=0), slots]
    last = boxes[jnp.argmax(jnp.where(mask, frames, -1), axis=0), slots]
    begin, end = _span(boxes, mask, first, last, tau)
    track = _track(boxes, mask, begin, end).at[0].set(first).at[-1].set(last)
    return Motion(active, active.any(axis=0), first, last, begin, track)


def _span(
    boxes: jax.Array, mask: jax.Array, first: jax.Array, last: jax.Array, tau: ArrayLike
) -> tuple[jax.Array, jax.Array]:
    """Frames in which objects leave their first and reach their last boxes, up to tau / 2 diagonals: (N,) float32 each.

    Boxes are compared by centre and size, because a lid that begins to open hardly moves its centre.
    """

    def near(place: jax.Array) -> jax.Array:
        return (safe_norm(boxes - place[None]) <= tau / 2 * safe_norm(boxes[..., 2:])) & mask

    frames = jnp.arange(boxes.shape[0])[:, None]
    final = jnp.max(jnp.where(mask, frames, 0), axis=0)
    begin = jnp.max(jnp.where(near(first), frames, 0), axis=0)
    end = jnp.min(jnp.where(near(last) & (frames > begin[None]), frames, final[None]), axis=0)
    return begin.astype(jnp.float32), jnp.maximum(end, begin).astype(jnp.float32)


def _track(boxes: jax.Array, mask: jax.Array, begin: jax.Array, end: jax.Array) -> jax.Array:
    """Boxes (K, N, 4) from `begin` to `end` (N,), with a margin for the way within tau; masked frames are skipped."""
    margin = 0.1 * (end - begin)
    share = jnp.linspace(0.0, 1.0, _TRACK)[:, None]
    wanted = (begin - margin)[None] + share * (end - begin + 2 * margin)[None]
    frames = jnp.arange(boxes.shape[0])[:, None]
    # The last frame that has the object, up to each frame.
    kept = jnp.maximum(jax.lax.cummax(jnp.where(mask, frames, -1), axis=0), jnp.argmax(mask, axis=0)[None])
    slots = jnp.arange(boxes.shape[1])
    nearest = jnp.clip(jnp.round(wanted), 0, boxes.shape[0] - 1).astype(jnp.int32)
    return boxes[kept[nearest, slots[None]], slots[None]]


def rearrange(
    key: jax.Array, objects: ObjectTable, motion: Motion, times: jax.Array, chances: Chances
) -> tuple[jax.Array, jax.Array]:
    """A random rearrangement of one demonstration.

    Args:
      key: randomness.
      objects: the object in each slot; several robot slots move as one.
      motion: the `Motion` of the demonstration.
      times: (F,) float32 in [0, 1], times of the frames to return, in order.
      chances: see `Chances`.

    Returns:
      Boxes (F, N, 4) float32 and activity (F, N) bool.
    """
    end_key, way_key, place_key, bump_key, before_key, trip_key, act_key = jax.random.split(key, 7)
    robot, fixture, articulated = objects.robot_flags(), objects.fixture_flags(), objects.articulated_flags()
    within = _within(motion, fixture)
    carried = _carried(motion, within, robot, fixture, articulated)
    here, there = jax.random.uniform(place_key, (2, *robot.shape, 2), minval=_MARGIN, maxval=1 - _MARGIN)
    robot_start = here[jnp.argmax(robot)]

    if any(objects.is_articulated):
        starts, ends = _anywhere(way_key, motion, articulated), motion.last[:, :2]
    else:
        ends = _ends(end_key, motion, within)
        total = jnp.sum(jnp.where(carried, safe_norm(motion.last[:, :2] - motion.first[:, :2]), 0.0))
        starts = _starts(way_key, ends, total, carried)
    robot_size = jnp.max(jnp.where(robot[:, None], motion.first[:, 2:], 0.0))
    grips = (jnp.max(motion.last[:, 2:], axis=-1) + robot_size) / 2
    trips = _trips(trip_key, carried, motion.begin, chances.in_order)
    stops = _stops(act_key, trips, starts, ends, grips, robot_start)
    spans = _spans(trips, stops, chances.approach, any(objects.is_articulated))
    brought, lifted, places = _bring(trips, stops, spans, articulated, times)
    # An articulated object that was never moved has no other place to be.
    stays = fixture | (articulated & ~carried)
    bystander = ~carried & ~stays & ~robot
    strays, strayed = _bumps(bump_key, bystander, times, chances.bumped)
    before = bystander & jax.random.bernoulli(before_key, chances.bumped_before, robot.shape)

    starts = jnp.where(carried[:, None], starts, jnp.where(stays[:, None], motion.first[:, :2], here))
    ends = jnp.where(carried[:, None], ends, jnp.where(strays[:, None], there, starts))
    share = jnp.where(carried, brought, jnp.where(robot, times[:, None], strayed))
    centres = jnp.where(robot[:, None], places[:, None], starts[None] + share[..., None] * (ends - starts)[None])
    sizes = motion.first[None, :, 2:] + share[..., None] * (motion.last - motion.first)[None, :, 2:]
    # Up in an image is down in its coordinates.
    centres = centres.at[..., 1].add(-lifted)
    boxes = jnp.concatenate([centres, sizes], axis=-1)
    boxes = jnp.where((articulated & carried)[:, None], _on_track(motion.track, share), boxes)
    away = safe_norm(boxes[..., :2] - jnp.where(robot[:, None], robot_start[None], starts)[None])
    moved = away > jnp.maximum(chances.tau * safe_norm(boxes[..., 2:]), _LEAST_MOVED)
    active = jax.lax.cummax(moved.astype(jnp.int32)) > 0
    return boxes, (active & ~fixture[None]) | before[None]


def _within(motion: Motion, fixture: jax.Array) -> jax.Array:
    """Whether each object's centre ended inside each fixture's box: (N, N) bool, [object, fixture]."""
    centres, sizes = motion.last[:, :2], motion.last[:, 2:]
    return jnp.all(jnp.abs(centres[:, None] - centres[None]) <= sizes[None] / 2, axis=-1) & fixture[None]


def _carried(
    motion: Motion, within: jax.Array, robot: jax.Array, fixture: jax.Array, articulated: jax.Array
) -> jax.Array:
    """The objects that were brought, (N,) bool: moved ones that are articulated or ended in a fixture, or all moved
    ones if none did."""
    moved = motion.moved & ~robot & ~fixture
    brought = moved & (within.any(axis=1) | articulated)
    return jnp.where(brought.any(), brought, moved)


def _anywhere(key: jax.Array, motion: Motion, articulated: jax.Array) -> jax.Array:
    """Starts of objects, (N, 2): where they were or anywhere in the image; articulated ones where they were."""
    stay_key, place_key = jax.random.split(key)
    stays = articulated | jax.random.bernoulli(stay_key, _AT_HOME, articulated.shape)
    places = jax.random.uniform(place_key, (articulated.shape[0], 2), minval=_MARGIN, maxval=1 - _MARGIN)
    return jnp.where(stays[:, None], motion.first[:, :2], places)


def _on_track(track: jax.Array, share: jax.Array) -> jax.Array:
    """Boxes (F, N, 4) at a share (F, N) of each object's track (K, N, 4)."""
    place = jnp.clip(share, 0.0, 1.0) * (track.shape[0] - 1)
    low = jnp.clip(place.astype(jnp.int32), 0, track.shape[0] - 2)
    slots = jnp.arange(track.shape[1])[None]
    rest = (place - low)[..., None]
    return (1 - rest) * track[low, slots] + rest * track[low + 1, slots]


def _ends(key: jax.Array, motion: Motion, within: jax.Array) -> jax.Array:
    """Ends of objects, (N, 2): the original end, or a random place in the fixture that contains it."""
    centres, sizes = motion.last[:, :2], motion.last[:, 2:]
    container = jnp.argmax(within, axis=1)
    drawn = jax.random.uniform(key, centres.shape, minval=INSET - 0.5, maxval=0.5 - INSET)
    return jnp.where(within.any(axis=1)[:, None], centres[container] + drawn * sizes[container], centres)


def _starts(key: jax.Array, ends: jax.Array, total: jax.Array, carried: jax.Array) -> jax.Array:
    """Starts of carried objects, (N, 2): the distance `total` () is divided among them, in random directions."""
    share_key, direction_key = jax.random.split(key)
    shares = jnp.where(carried, jax.random.exponential(share_key, carried.shape), 0.0)
    ways = total * shares / jnp.maximum(jnp.sum(shares), 1e-6)
    angles = jax.random.uniform(direction_key, (_DIRECTIONS, *carried.shape), maxval=2 * jnp.pi)
    places = ends[None] + ways[None, :, None] * jnp.stack([jnp.cos(angles), jnp.sin(angles)], axis=-1)
    # The first direction that stays in the image; if none does, the start is clipped to the image.
    outside = jnp.max(jnp.abs(places - 0.5), axis=-1) > 0.5 - _MARGIN
    first = places[jnp.argmin(outside, axis=0), jnp.arange(carried.shape[0])]
    return jnp.clip(first, _MARGIN, 1 - _MARGIN)


class _Trips(NamedTuple):
    """Trips in order: object (P,) int32, the share of its way before and after the trip (P,), made (P,) bool, and the
    largest height above the straight way in image sides (P,).

    There are P = 2 N trips. Those that are not made come last.
    """

    object: jax.Array
    before: jax.Array
    after: jax.Array
    made: jax.Array
    height: jax.Array


def _trips(key: jax.Array, carried: jax.Array, begin: jax.Array, in_order: ArrayLike) -> _Trips:
    """One or two trips per carried object, in random order, or with probability `in_order` in that of `begin` (N,)."""
    number = carried.shape[0]
    order_key, put_down_key, share_key, choice_key, height_key = jax.random.split(key, 5)
    put_down = jax.random.bernoulli(put_down_key, _PUT_DOWN, (number,))
    share = jnp.where(put_down, jax.random.uniform(share_key, (number,)), 1.0)
    # Sorted, so that an object's first trip comes before its second.
    turns = jnp.sort(jax.random.uniform(order_key, (2, number)), axis=0)
    rank = jnp.argsort(jnp.argsort(begin)) / number
    demonstrated = jnp.stack([rank, rank + 0.5 / number])
    turns = jnp.where(jax.random.bernoulli(choice_key, in_order), demonstrated, turns)
    made = jnp.stack([carried, carried & put_down])
    order = jnp.argsort(jnp.where(made, turns, 2.0).ravel())
    before = jnp.stack([jnp.zeros_like(share), share]).ravel()[order]
    after = jnp.stack([share, jnp.ones_like(share)]).ravel()[order]
    height = jax.random.uniform(height_key, order.shape, minval=-_MOST_LIFTED, maxval=_MOST_LIFTED)
    return _Trips(order % number, before, after, made.ravel()[order], jnp.maximum(height, 0.0))


def _stops(
    key: jax.Array, trips: _Trips, starts: jax.Array, ends: jax.Array, grips: jax.Array, here: jax.Array
) -> jax.Array:
    """The robot's places, (1 + 2P, 2): `here` (2,), then where each trip picks its object up and puts it down."""
    angle_key, grip_key = jax.random.split(key)
    angles = jax.random.uniform(angle_key, trips.object.shape, maxval=2 * jnp.pi)
    distances = grips[trips.object] * jax.random.uniform(grip_key, angles.shape, minval=_GRIP[0], maxval=_GRIP[1])
    offsets = distances[:, None] * jnp.stack([jnp.cos(angles), jnp.sin(angles)], axis=-1)
    origin = starts[trips.object] + offsets
    way = jnp.where(trips.made[:, None], (ends - starts)[trips.object], 0.0)
    picked, dropped = (origin + share[:, None] * way for share in (trips.before, trips.after))
    stops = jnp.concatenate([here[None], jnp.stack([picked, dropped], axis=1).reshape(-1, 2)])
    # Without further trips the robot stays at its last stop.
    return stops[jnp.minimum(jnp.arange(stops.shape[0]), 2 * jnp.sum(trips.made))]


def _spans(trips: _Trips, stops: jax.Array, approach: ArrayLike, even: bool) -> jax.Array:
    """Time between stops, (2P,): as the distance, or if `even` as the share of the object's way; ways to objects are
    faster by the factor `approach`."""
    if even:
        gained = jnp.where(trips.made, trips.after - trips.before, 0.0)
        ways = jnp.stack([trips.made.astype(jnp.float32), gained], axis=1).ravel()
    else:
        ways = safe_norm(stops[1:] - stops[:-1])
    return ways * jnp.tile(jnp.stack([approach, 1.0]), trips.made.shape[0])


def _bring(
    trips: _Trips, stops: jax.Array, spans: jax.Array, articulated: jax.Array, times: jax.Array
) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Makes the trips one after another and samples them at `times` (F,).

    Returns:
      The share of its way that each object has covered, (F, N); its height above the straight way in image sides, if
      any object is articulated, (F, N); and the robot's centre, (F, 2).
    """
    clock = jnp.concatenate([jnp.zeros(1), jnp.cumsum(spans)])
    now = times * clock[-1]
    done = jnp.clip((now[:, None] - clock[None, 1::2]) / jnp.maximum(spans[None, 1::2], 1e-6), 0.0, 1.0)
    free = articulated.any() & ~articulated[trips.object]
    done = jnp.where(free[None], 1 - (1 - done) ** _SLOWING, done)
    gained = jnp.where(trips.made, trips.after - trips.before, 0.0)[None] * done
    zeros = jnp.zeros((times.shape[0], articulated.shape[0]))
    brought = zeros.at[:, trips.object].add(gained)
    height = jnp.where(free, trips.height, 0.0)
    lifted = zeros.at[:, trips.object].add(height[None] * jnp.sin(jnp.pi * done))
    places = jnp.stack([jnp.interp(now, clock, stops[:, axis]) for axis in range(2)], axis=-1)
    return brought, lifted, jnp.clip(places, _MARGIN, 1 - _MARGIN)


def _bumps(key: jax.Array, candidates: jax.Array, times: jax.Array, bumped: ArrayLike) -> tuple[jax.Array, jax.Array]:
    """Which of the candidates (N,) are bumped, (N,) bool, and the share of its way that each has covered, (F, N)."""
    choice_key, begin_key, span_key = jax.random.split(key, 3)
    strays = candidates & jax.random.bernoulli(choice_key, bumped, candidates.shape)
    begin = (1 - _SHORTEST_BUMP) * jax.random.uniform(begin_key, strays.shape)
    span = _SHORTEST_BUMP + (1 - _SHORTEST_BUMP - begin) * jax.random.uniform(span_key, strays.shape)
    return strays, strays[None] * jnp.clip((times[:, None] - begin[None]) / span[None], 0.0, 1.0)
