"""The environmental reward: that of the original experiments, with a disclosed term that leads to the next target."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp

from tasks.match_regions import geometry
from tasks.match_regions.layouts import NUM_TARGETS, blocks
from tasks.match_regions.state import PhysicsState, grasp_point, inside, placed_targets

REACH_PER_TARGET = 1.5


@dataclass(frozen=True)
class Reward:
    """Constants of the environmental reward 10 tanh(p / targets); p = progress - distractors inside - time penalty.

    The reach term is not part of the original: p also loses `reach` times the remaining way to the targets. This is the
    distance from the grasp point to the nearest target outside the region, plus `REACH_PER_TARGET` for every further
    one, so that placing a target never costs. A `reach` of 0 gives the original.
    """

    scale: float = 10.0
    time_penalty: float = 0.1
    reach: float = 0.75


def environment_reward(state: PhysicsState, constants: Reward) -> jax.Array:
    """The original experiments' reward of a state, plus the disclosed reach term; ()."""
    targets = blocks(state.qpos)[:NUM_TARGETS, :2]
    placed = placed_targets(state.qpos, state.world)
    distance = jnp.linalg.norm(targets - geometry.region_centre(state.world.region)[None], axis=-1)
    progress = jnp.sum(state.initial_distance - jnp.where(placed, 0.0, distance))
    distractors = inside(state.qpos, state.world)[NUM_TARGETS:].sum()
    to_target = jnp.linalg.norm(targets - grasp_point(state.qpos)[None], axis=-1)
    nearest = jnp.where(placed.all(), 0.0, jnp.min(jnp.where(placed, jnp.inf, to_target)))
    reach = nearest + REACH_PER_TARGET * jnp.maximum(jnp.sum(~placed) - 1, 0)
    potential = progress - distractors - constants.time_penalty - constants.reach * reach
    return constants.scale * jnp.tanh(potential / state.world.present[:NUM_TARGETS].sum())
