"""The physics state of Match Regions, and quantities computed from it."""

from typing import NamedTuple

import jax
import jax.numpy as jnp

from tasks.match_regions import geometry
from tasks.match_regions.layouts import NUM_TARGETS, World, blocks

GRASP_REACH = 0.32


class PhysicsState(NamedTuple):
    """State kept between steps; the rest of the simulation follows from it. V = 5 + 3M.

    | field            | shape | dtype   | meaning                                                               |
    |------------------|-------|---------|-----------------------------------------------------------------------|
    | qpos             | (V,)  | float32 | robot x, y, theta; fingers (2,); then x, y, theta per block           |
    | qvel             | (V,)  | float32 | their rates                                                           |
    | warmstart        | (V,)  | float32 | accelerations the solver starts from                                  |
    | initial_distance | (2,)  | float32 | distance of each target's home (`layouts.Start`) from the region's    |
    |                  |       |         | centre; 0 for an absent target                                        |
    | world            |       |         | `layouts.World`, the same throughout                                  |
    """

    qpos: jax.Array
    qvel: jax.Array
    warmstart: jax.Array
    initial_distance: jax.Array
    world: World


def at_rest(qpos: jax.Array, world: World) -> PhysicsState:
    """The state at rest at `qpos`, with initial distances 0."""
    return PhysicsState(qpos, jnp.zeros_like(qpos), jnp.zeros_like(qpos), jnp.zeros(NUM_TARGETS), world)


def inside(qpos: jax.Array, world: World) -> jax.Array:
    """Whether each block is present and has its centre inside the region: (M,) bool."""
    return geometry.inside_region(world.region, blocks(qpos)[:, :2]) & world.present


def placed_targets(qpos: jax.Array, world: World) -> jax.Array:
    """Whether each target is inside the region or absent: (2,) bool."""
    return (inside(qpos, world) | ~world.present)[:NUM_TARGETS]


def boxes(qpos: jax.Array, world: World) -> tuple[jax.Array, jax.Array]:
    """Image-plane boxes (2 + M, 4) and mask (2 + M,) of region, robot and blocks."""
    region, robot = geometry.region_box(world.region), geometry.robot_box(qpos[:3], qpos[3:5])
    rows = [region[None], robot[None], geometry.block_boxes(blocks(qpos), world.shapes)]
    return jnp.concatenate(rows), jnp.concatenate([jnp.ones(2, bool), world.present])


def score(qpos: jax.Array, world: World) -> jax.Array:
    """MAGICAL's score of a final state: share of targets inside times share of targets among blocks inside; ()."""
    found = inside(qpos, world).astype(jnp.float32)
    targets, total = found[:NUM_TARGETS].sum(), found.sum()
    return (targets / world.present[:NUM_TARGETS].sum()) * (targets / jnp.maximum(total, 1.0))


def grasp_point(qpos: jax.Array) -> jax.Array:
    """Position of a held block's centre, between the fingers, in the arena: (2,)."""
    return qpos[:2] + GRASP_REACH * geometry.heading(qpos[2])
