"""How the expert drives: to a place beside a block, and with a block that it holds.

Speed and turn are those of the task's actions.
"""

import jax
import jax.numpy as jnp

from tasks.match_regions import geometry
from tasks.match_regions.env import BACKWARD_SPEED, FORWARD_SPEED
from tasks.match_regions.model import CONTROL_DT
from tasks.match_regions.observation import TURN_RATE
from tasks.match_regions.paths import length_at

STANDOFF = 0.58
"""Distance from a block of the place where the robot turns to it."""
AT_WALL = 0.78
# Directions from which a block may be gripped, and the distance from the robot's middle at which it is held.
_SIDES, _HOLD = 8, 0.33
# Control steps that a unit of way or a radian of turn takes at full speed, and a unit that a standoff lies in a wall.
_FORWARDS, _BACKWARDS, _TURN = (1 / (speed * CONTROL_DT) for speed in (FORWARD_SPEED, BACKWARD_SPEED, TURN_RATE))
_IN_WALL = 100.0


def within(place: jax.Array) -> jax.Array:
    """The nearest place (2,) where the robot has room."""
    return jnp.clip(place, -AT_WALL, AT_WALL)


def quickest_side(
    lengths: jax.Array, robot: jax.Array, block: jax.Array, goal: jax.Array, aside: jax.Array
) -> jax.Array:
    """The direction, (2,), from a block to the standoff that the robot is soonest at, facing the block.

    Args:
      lengths: `paths.distances` from the robot.
      robot, block, goal: places, (2,) each.
      aside: () radians that all directions are turned by.
    """
    angles = jnp.arange(_SIDES) * (2 * jnp.pi / _SIDES) + aside
    sides = jax.vmap(lambda angle: geometry.rotation(angle) @ unit(goal - block))(angles)
    standoffs = block[None] + STANDOFF * sides
    in_wall = jnp.sum(jnp.maximum(jnp.abs(standoffs) - AT_WALL, 0.0), axis=-1)
    length = length_at(lengths, standoffs)

    def steps(standoff: jax.Array, side: jax.Array, length: jax.Array) -> jax.Array:
        """Steps to a standoff; the turn there counts less if it is near, because the robot is not turned by its way."""
        off = jnp.abs(bearing(standoff - robot, -side)) * jnp.minimum(1.0, length / 0.2)
        return jnp.minimum(length * _FORWARDS + off * _TURN, length * _BACKWARDS + (jnp.pi - off) * _TURN)

    return sides[jnp.argmin(jax.vmap(steps)(standoffs, sides, length) + _IN_WALL * in_wall)]


def go_to(qpos: jax.Array, point: jax.Array, way: jax.Array, facing: jax.Array) -> jax.Array:
    """Speed and turn, (2,), that take the robot on its way to a point where it is to face in a direction, (2,) each.

    It goes forwards or backwards, whichever is quicker.
    """
    robot, ahead = qpos[:2], geometry.heading(qpos[2])
    straight = point - robot
    length = jnp.linalg.norm(straight)

    def steps(sign: float, pace: float) -> jax.Array:
        turns = jnp.abs(bearing(sign * ahead, way)) + jnp.abs(bearing(sign * straight, facing))
        return turns * _TURN + length * pace

    sign = jnp.where(steps(-1.0, _BACKWARDS) < steps(1.0, _FORWARDS), -1.0, 1.0)
    off = bearing(sign * ahead, way)
    speed = jnp.maximum(jnp.cos(off), 0.0) ** 2 * jnp.clip(5 * length, 0.3, 1.0)
    return jnp.stack([sign * speed, turn(off)])


def carry(ahead: jax.Array, way: jax.Array, length: jax.Array) -> jax.Array:
    """Speed and turn, (2,), that move a held block along its way (2,), of which so much is left.

    The block stays at a fixed place ahead of the robot, so the robot's speed moves it along the heading and the turn
    across it: the robot need not line up first.
    """
    wanted = unit(way) * jnp.clip(8 * length, 0.3, 1.0)
    along, across = ahead @ wanted, _cross(ahead, wanted)
    speed = along * jnp.where(along > 0, 1.0, FORWARD_SPEED / BACKWARD_SPEED)
    command = jnp.stack([speed, across * FORWARD_SPEED / (_HOLD * TURN_RATE)])
    return command / jnp.maximum(jnp.max(jnp.abs(command)), 1.0)


def turn(bearing: jax.Array) -> jax.Array:
    """Turn command that removes a bearing within a control step or two."""
    return jnp.clip(bearing * _TURN / 1.3, -1.0, 1.0)


def bearing(ahead: jax.Array, direction: jax.Array) -> jax.Array:
    """Signed angle from `ahead` to `direction`, counter-clockwise positive."""
    return jnp.arctan2(_cross(ahead, direction), ahead @ direction)


def _cross(one: jax.Array, other: jax.Array) -> jax.Array:
    """The part of `other` to the left of the unit vector `one`."""
    return one[0] * other[1] - one[1] * other[0]


def unit(vector: jax.Array) -> jax.Array:
    return vector / jnp.maximum(jnp.linalg.norm(vector), 1e-6)
