"""Rearranged demonstrations: the same objects brought to the same place, from elsewhere and in another order.

Demonstrations of a task start and proceed alike, so an encoder trained on them alone knows nothing of other places, and
those are where a policy goes. A rearrangement keeps what a video shows of the goal, where objects end, and draws anew
how they got there:

- every object that was moved starts somewhere else and goes straight to its end; what ends inside a fixture's box may
  end anywhere in it;
- objects go one after the other or together, and the way that is left, summed over them, falls evenly with time from
  what it was in the original (less where the image's border cuts it): demonstrations of one layout differ little in
  that sum, so frames with the same way to go are what cycle-consistency will match;
- what was never moved lies anywhere, is bumped to another place now and then, and the robot goes from anywhere to
  anywhere, so that none of them tells progress;
- fixtures (`ObjectTable.is_fixture`) stay.

Boxes, activity and time are all it takes; there is no paper behind it.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike

from graphrl_jax.graph import ObjectTable, activity, safe_norm

# Centres stay this far from the image's border, in image sides.
_MARGIN = 0.08
# Places inside a fixture's box keep this share of its side from its border.
_INSET = 0.05
# The least share of a rearranged demonstration (before time is dealt out evenly) that one object takes.
_SHORTEST_MOVE = 0.15
_DIRECTIONS, _CLOCK_TICKS = 16, 101


class Motion(NamedTuple):
    """Who moved in one demonstration, and from where to where.

    | field  | shape  | dtype   | meaning                                   |
    |--------|--------|---------|-------------------------------------------|
    | active | (T, N) | bool    | activity at the full frame rate           |
    | moved  | (N,)   | bool    | activity at the last frame                |
    | first  | (N, 4) | float32 | box in the first frame that has the object |
    | last   | (N, 4) | float32 | box in the last frame that has it         |
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
    key: jax.Array, objects: ObjectTable, motion: Motion, times: jax.Array, bumped: ArrayLike
) -> tuple[jax.Array, jax.Array]:
    """A demonstration, rearranged.

    Args:
      key: randomness.
      objects: which object sits in which slot.
      motion: of the demonstration.
      times: (F,) float32 in [0, 1], the frames wanted.
      bumped: probability that an object that was never moved gets a move of its own (which may begin too late to be
        seen).

    Returns:
      Boxes (F, N, 4) float32 and activity (F, N) bool.
    """
    start_key, end_key, way_key, move_key, bump_key = jax.random.split(key, 5)
    robot, fixture = objects.robot_flags(), objects.fixture_flags()
    carried = motion.moved & ~robot & ~fixture
    ends = _ends(end_key, motion, fixture)
    total = jnp.sum(jnp.where(carried, safe_norm(motion.last[:, :2] - motion.first[:, :2]), 0.0))
    starts = _starts(way_key, ends, total, carried)
    share = _shares(move_key, jnp.where(carried, safe_norm(starts - ends), 0.0), times)

    here, there = (_anywhere(anywhere_key, robot.shape[0]) for anywhere_key in jax.random.split(start_key))
    strays = robot | (jax.random.bernoulli(bump_key, bumped, robot.shape) & ~carried & ~fixture)
    starts = jnp.where(carried[:, None], starts, jnp.where(fixture[:, None], motion.first[:, :2], here))
    ends = jnp.where(carried[:, None], ends, jnp.where(strays[:, None], there, starts))
    centres = starts + share[..., None] * (ends - starts)
    sizes = motion.first[:, 2:] + share[..., None] * (motion.last - motion.first)[:, 2:]
    return jnp.concatenate([centres, sizes], axis=-1), (carried | strays) & (share > 0)


def _ends(key: jax.Array, motion: Motion, fixture: jax.Array) -> jax.Array:
    """Where objects end, (N, 2): where they did, or anywhere in the fixture they ended in."""
    centres, sizes = motion.last[:, :2], motion.last[:, 2:]
    within = jnp.all(jnp.abs(centres[:, None] - centres) <= sizes / 2, axis=-1) & fixture
    container = jnp.argmax(within, axis=1)
    drawn = jax.random.uniform(key, centres.shape, minval=_INSET - 0.5, maxval=0.5 - _INSET)
    return jnp.where(within.any(axis=1)[:, None], centres[container] + drawn * sizes[container], centres)


def _starts(key: jax.Array, ends: jax.Array, total: jax.Array, carried: jax.Array) -> jax.Array:
    """Where carried objects start, (N, 2): `total` () is dealt out among them, and each set off in some direction."""
    share_key, direction_key = jax.random.split(key)
    shares = jnp.where(carried, jax.random.exponential(share_key, carried.shape), 0.0)
    ways = total * shares / jnp.maximum(jnp.sum(shares), 1e-6)
    angles = jax.random.uniform(direction_key, (_DIRECTIONS, *carried.shape), maxval=2 * jnp.pi)
    places = ends + ways[:, None] * jnp.stack([jnp.cos(angles), jnp.sin(angles)], axis=-1)
    # The first direction that stays in the image; if none does, as far as the image goes.
    outside = jnp.max(jnp.abs(places - 0.5), axis=-1) > 0.5 - _MARGIN
    first = places[jnp.argmin(outside, axis=0), jnp.arange(carried.shape[0])]
    return jnp.clip(first, _MARGIN, 1 - _MARGIN)


def _shares(key: jax.Array, ways: jax.Array, times: jax.Array) -> jax.Array:
    """How much of its way (N,) each object has behind it at `times` (F,), such that the sum grows evenly: (F, N)."""
    begin_key, span_key = jax.random.split(key)
    begin = (1 - _SHORTEST_MOVE) * jax.random.uniform(begin_key, ways.shape)
    span = _SHORTEST_MOVE + (1 - _SHORTEST_MOVE - begin) * jax.random.uniform(span_key, ways.shape)

    def shares(clock: jax.Array) -> jax.Array:
        return jnp.clip((clock[:, None] - begin) / span, 0.0, 1.0)

    clock = jnp.linspace(0.0, 1.0, _CLOCK_TICKS)
    gone = shares(clock) @ ways
    # While nothing moves no time passes; the small term makes the clock readable there too.
    gone = gone / jnp.maximum(gone[-1], 1e-6) + 1e-5 * clock
    return shares(jnp.interp(times, gone, clock))


def _anywhere(key: jax.Array, count: int) -> jax.Array:
    return jax.random.uniform(key, (count, 2), minval=_MARGIN, maxval=1 - _MARGIN)
