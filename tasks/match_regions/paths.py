"""Shortest ways round the blocks, on a grid over the arena, by a few dozen sweeps of value iteration."""

import math

import jax
import jax.numpy as jnp

from tasks.match_regions.model import ARENA_HALF, ROBOT_RADIUS

CLEARANCE = 0.44
"""Distance from a block's centre that ways keep, if there is room."""
_CELLS = 17
_REACH = ARENA_HALF - ROBOT_RADIUS
_CELL = 2 * _REACH / (_CELLS - 1)
_SWEEPS = 28
# Times by which a way through a block is longer. It is not closed, so that every place has a way.
_CROSSING = 8.0
_EDGE = 0.1
_FAR = 1e3
_NEIGHBOURS = [(dx, dy) for dx in (-1, 0, 1) for dy in (-1, 0, 1) if (dx, dy) != (0, 0)]
_DIRECTIONS, _LOOK = 24, 0.2


def distances(obstacles: jax.Array, end: jax.Array) -> jax.Array:
    """Lengths of the shortest ways between every cell of the grid and a point.

    Args:
      obstacles: (M, 2), centres of blocks; absent ones lie outside the arena.
      end: (2,), the point.

    Returns:
      (G, G) float32 by x and y, in arena units; the part of a way that is close to a block counts as longer.
    """
    axis = jnp.linspace(-_REACH, _REACH, _CELLS)
    cells = jnp.stack(jnp.meshgrid(axis, axis, indexing="ij"), axis=-1)
    gaps = jnp.min(jnp.linalg.norm(cells[:, :, None] - obstacles[None, None], axis=-1), axis=-1)
    cost = 1.0 + _CROSSING * jnp.clip((CLEARANCE - gaps) / _EDGE, 0.0, 1.0)
    straight = jnp.linalg.norm(cells - end[None, None], axis=-1)
    start = jnp.where(straight < 1.5 * _CELL, straight, _FAR)

    def sweep(_: int, lengths: jax.Array) -> jax.Array:
        padded = jnp.pad(lengths, 1, constant_values=_FAR)
        for dx, dy in _NEIGHBOURS:
            neighbour = padded[1 + dx : 1 + dx + _CELLS, 1 + dy : 1 + dy + _CELLS]
            lengths = jnp.minimum(lengths, neighbour + _CELL * math.hypot(dx, dy) * cost)
        return lengths

    return jax.lax.fori_loop(0, _SWEEPS, sweep, start)


def length_at(lengths: jax.Array, points: jax.Array) -> jax.Array:
    """Lengths (K,) at points (K, 2), interpolated in the grid (G, G); points outside it count as on its border."""
    place = jnp.clip((points + _REACH) / _CELL, 0.0, _CELLS - 1.001)
    low = place.astype(jnp.int32)
    (x, y), (u, v) = low.T, (place - low).T
    near, far = ((1 - v) * lengths[column, y] + v * lengths[column, y + 1] for column in (x, x + 1))
    return (1 - u) * near + u * far


def direction(lengths: jax.Array, here: jax.Array, end: jax.Array) -> jax.Array:
    """Direction (2,), of any length, of the shortest way from `here` (2,) to `end` (2,), which `lengths` lead to."""
    angles = jnp.arange(_DIRECTIONS) * (2 * math.pi / _DIRECTIONS)
    around = _LOOK * jnp.stack([jnp.cos(angles), jnp.sin(angles)], axis=-1)
    places = here[None] + around
    outside = jnp.maximum(jnp.max(jnp.abs(places), axis=-1) - _REACH, 0.0)
    best = around[jnp.argmin(length_at(lengths, places) + 10 * outside)]
    return jnp.where(jnp.linalg.norm(end - here) < 1.25 * _LOOK, end - here, best)
