"""The state of an episode of Match Regions, and what can be read off it."""

from typing import NamedTuple

import jax
import jax.numpy as jnp

from tasks.match_regions import geometry
from tasks.match_regions.layouts import NUM_TARGETS, Scene, blocks

GRASP_REACH = 0.32


class PhysicsState(NamedTuple):
    """What is carried from step to step; the rest of `mjx.Data` is rebuilt from a template. V = 5 + 3M.

    | field            | shape | dtype   | meaning                                                               |
    |------------------|-------|---------|-----------------------------------------------------------------------|
    | qpos             | (V,)  | float32 | robot x, y, theta; fingers (2,); then x, y, theta per block           |
    | qvel             | (V,)  | float32 | their rates                                                           |
    | warmstart        | (V,)  | float32 | accelerations the solver starts from                                  |
    | initial_distance | (2,)  | float32 | of each target to the region's centre when the episode began; where a |
    |                  |       |         | target that began inside had come from                                |
    | scene            |       |         | `layouts.Scene`, the same throughout                                  |
    """

    qpos: jax.Array
    qvel: jax.Array
    warmstart: jax.Array
    initial_distance: jax.Array
    scene: Scene


def at_rest(qpos: jax.Array, scene: Scene) -> PhysicsState:
    """A still scene at `qpos`, whose targets have no way behind them."""
    return PhysicsState(qpos, jnp.zeros_like(qpos), jnp.zeros_like(qpos), jnp.zeros(NUM_TARGETS), scene)


def inside(qpos: jax.Array, scene: Scene) -> jax.Array:
    """Whether each block is there with its centre inside the region: (M,) bool."""
    return geometry.inside_region(scene.region, blocks(qpos)[:, :2]) & scene.present


def placed_targets(qpos: jax.Array, scene: Scene) -> jax.Array:
    """Which targets need no more bringing, because they are inside or not there: (2,) bool."""
    return (inside(qpos, scene) | ~scene.present)[:NUM_TARGETS]


def boxes(qpos: jax.Array, scene: Scene) -> tuple[jax.Array, jax.Array]:
    """Image-plane boxes (2 + M, 4) and mask (2 + M,) of region, robot and blocks."""
    region, robot = geometry.region_box(scene.region), geometry.robot_box(qpos[:3], qpos[3:5])
    rows = [region[None], robot[None], geometry.block_boxes(blocks(qpos), scene.shapes)]
    return jnp.concatenate(rows), jnp.concatenate([jnp.ones(2, bool), scene.present])


def score(qpos: jax.Array, scene: Scene) -> jax.Array:
    """MAGICAL's score of a final state: share of targets inside times share of targets among all inside; ()."""
    found = inside(qpos, scene).astype(jnp.float32)
    targets, total = found[:NUM_TARGETS].sum(), found.sum()
    return (targets / scene.present[:NUM_TARGETS].sum()) * (targets / jnp.maximum(total, 1.0))


def grasp_point(qpos: jax.Array) -> jax.Array:
    """Where a held block's centre sits, between the fingers, in the arena: (2,)."""
    return qpos[:2] + GRASP_REACH * geometry.heading(qpos[2])
