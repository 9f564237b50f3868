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


class Motion(NamedTuple):
    """Activity and first and last boxes of the objects in one demonstration.

    | field  | shape  | dtype   | meaning                                     |
    |--------|--------|---------|---------------------------------------------|
    | active | (T, N) | bool    | activity at the full frame rate             |
    | moved  | (N,)   | bool    | activity in the last frame                  |
    | first  | (N, 4) | float32 | box in the first frame that has the object  |
    | last   | (N, 4) | float32 | box in the last frame that has the object   |
    """

    active: jax.Array
    moved: jax.Array
    first: jax.Array
    last: jax.Array


def motion(boxes: jax.Array, mask: jax.Array, length: ArrayLike, tau: ArrayLike) -> Motion:
    """`Motion` of a padded demonstration: boxes (T, N, 4), mask (T, N), length () and activity threshold tau."""
    frames = jnp.arange(boxes.shape[0])[:, None]
    mask = mask & (frames < length)
    active = activity(boxes, mask, tau)
    slots = jnp.arange(boxes.shape[1])
    first = boxes[jnp.argmax(mask, axis=0), slots]
    last = boxes[jnp.argmax(jnp.where(mask, frames, -1), axis=0), slots]
    return Motion(active, active[length - 1], first, last)


def rearrange(
    key: jax.Array,
    objects: ObjectTable,
    motion: Motion,
    times: jax.Array,
    bumped: ArrayLike,
    bumped_before: ArrayLike,
    approach: ArrayLike,
) -> tuple[jax.Array, jax.Array]:
    """A random rearrangement of one demonstration.

    Args:
      key: randomness.
      objects: the object in each slot; several robot slots move as one.
      motion: the `Motion` of the demonstration.
      times: (F,) float32 in [0, 1], times of the frames to return.
      bumped: probability that an object that is not brought is bumped.
      bumped_before: probability that such an object counts as moved from the first frame on.
      approach: time of the robot's way to an object, relative to bringing an object as far.

    Returns:
      Boxes (F, N, 4) float32 and activity (F, N) bool.
    """
    end_key, way_key, place_key, bump_key, before_key, trip_key, act_key = jax.random.split(key, 7)
    robot, fixture = objects.robot_flags(), objects.fixture_flags()
    within = _within(motion, fixture)
    carried = _carried(motion, within, robot, fixture)
    here, there = jax.random.uniform(place_key, (2, *robot.shape, 2), minval=_MARGIN, maxval=1 - _MARGIN)

    ends = _ends(end_key, motion, within)
    total = jnp.sum(jnp.where(carried, safe_norm(motion.last[:, :2] - motion.first[:, :2]), 0.0))
    starts = _starts(way_key, ends, total, carried)
    robot_size = jnp.max(jnp.where(robot[:, None], motion.first[:, 2:], 0.0))
    grips = (jnp.max(motion.last[:, 2:], axis=-1) + robot_size) / 2
    trips = _trips(trip_key, carried)
    brought, places = _bring(act_key, trips, starts, ends, grips, here[jnp.argmax(robot)], times, approach)
    bystander = ~carried & ~fixture & ~robot
    strays, strayed = _bumps(bump_key, bystander, times, bumped)
    before = bystander & jax.random.bernoulli(before_key, bumped_before, robot.shape)

    starts = jnp.where(carried[:, None], starts, jnp.where(fixture[:, None], motion.first[:, :2], here))
    ends = jnp.where(carried[:, None], ends, jnp.where(strays[:, None], there, starts))
    share = jnp.where(carried, brought, jnp.where(robot, times[:, None], strayed))
    centres = jnp.where(robot[:, None], places[:, None], starts[None] + share[..., None] * (ends - starts)[None])
    sizes = motion.first[None, :, 2:] + share[..., None] * (motion.last - motion.first)[None, :, 2:]
    return jnp.concatenate([centres, sizes], axis=-1), (share > 0) | before[None]


def _within(motion: Motion, fixture: jax.Array) -> jax.Array:
    """Whether each object's centre ended inside each fixture's box: (N, N) bool, [object, fixture]."""
    centres, sizes = motion.last[:, :2], motion.last[:, 2:]
    return jnp.all(jnp.abs(centres[:, None] - centres[None]) <= sizes[None] / 2, axis=-1) & fixture[None]


def _carried(motion: Motion, within: jax.Array, robot: jax.Array, fixture: jax.Array) -> jax.Array:
    """The objects that were brought, (N,) bool: moved ones that ended in a fixture, or all moved ones if none did."""
    moved = motion.moved & ~robot & ~fixture
    brought = moved & within.any(axis=1)
    return jnp.where(brought.any(), brought, moved)


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
    """Trips in order: object (P,) int32, the share of its way before and after the trip (P,), made (P,) bool.

    There are P = 2 N trips. Those that are not made come last.
    """

    object: jax.Array
    before: jax.Array
    after: jax.Array
    made: jax.Array


def _trips(key: jax.Array, carried: jax.Array) -> _Trips:
    """One or two trips per carried object, in random order."""
    number = carried.shape[0]
    order_key, put_down_key, share_key = jax.random.split(key, 3)
    put_down = jax.random.bernoulli(put_down_key, _PUT_DOWN, (number,))
    share = jnp.where(put_down, jax.random.uniform(share_key, (number,)), 1.0)
    # Sorted, so that an object's first trip comes before its second.
    turns = jnp.sort(jax.random.uniform(order_key, (2, number)), axis=0)
    made = jnp.stack([carried, carried & put_down])
    order = jnp.argsort(jnp.where(made, turns, 2.0).ravel())
    before = jnp.stack([jnp.zeros_like(share), share]).ravel()[order]
    after = jnp.stack([share, jnp.ones_like(share)]).ravel()[order]
    return _Trips(order % number, before, after, made.ravel()[order])


def _bring(
    key: jax.Array,
    trips: _Trips,
    starts: jax.Array,
    ends: jax.Array,
    grips: jax.Array,
    here: jax.Array,
    times: jax.Array,
    approach: ArrayLike,
) -> tuple[jax.Array, jax.Array]:
    """Makes the trips one after another, starting with the robot at `here` (2,), and samples them at `times` (F,).

    Returns:
      The share of its way that each object has covered, (F, N), and the robot's centre, (F, 2).
    """
    angle_key, grip_key = jax.random.split(key)
    angles = jax.random.uniform(angle_key, trips.object.shape, maxval=2 * jnp.pi)
    distances = grips[trips.object] * jax.random.uniform(grip_key, angles.shape, minval=_GRIP[0], maxval=_GRIP[1])
    offsets = distances[:, None] * jnp.stack([jnp.cos(angles), jnp.sin(angles)], axis=-1)
    origin = starts[trips.object] + offsets
    way = jnp.where(trips.made[:, None], (ends - starts)[trips.object], 0.0)
    picked, dropped = (origin + share[:, None] * way for share in (trips.before, trips.after))
    stops = jnp.concatenate([here[None], jnp.stack([picked, dropped], axis=1).reshape(-1, 2)])
    # Without further trips the robot stays at its last stop.
    stops = stops[jnp.minimum(jnp.arange(stops.shape[0]), 2 * jnp.sum(trips.made))]

    spans = safe_norm(stops[1:] - stops[:-1]) * jnp.tile(jnp.stack([approach, 1.0]), trips.made.shape[0])
    clock = jnp.concatenate([jnp.zeros(1), jnp.cumsum(spans)])
    now = times * clock[-1]
    done = jnp.clip((now[:, None] - clock[None, 1::2]) / jnp.maximum(spans[None, 1::2], 1e-6), 0.0, 1.0)
    gained = jnp.where(trips.made, trips.after - trips.before, 0.0)[None] * done
    brought = jnp.zeros((times.shape[0], starts.shape[0])).at[:, trips.object].add(gained)
    places = jnp.stack([jnp.interp(now, clock, stops[:, axis]) for axis in range(2)], axis=-1)
    return brought, jnp.clip(places, _MARGIN, 1 - _MARGIN)


def _bumps(key: jax.Array, candidates: jax.Array, times: jax.Array, bumped: ArrayLike) -> tuple[jax.Array, jax.Array]:
    """Which of the candidates (N,) are bumped, (N,) bool, and the share of its way that each has covered, (F, N)."""
    choice_key, begin_key, span_key = jax.random.split(key, 3)
    strays = candidates & jax.random.bernoulli(choice_key, bumped, candidates.shape)
    begin = (1 - _SHORTEST_BUMP) * jax.random.uniform(begin_key, strays.shape)
    span = _SHORTEST_BUMP + (1 - _SHORTEST_BUMP - begin) * jax.random.uniform(span_key, strays.shape)
    return strays, strays[None] * jnp.clip((times[:, None] - begin[None]) / span[None], 0.0, 1.0)
