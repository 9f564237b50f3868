"""The observation: (59,) float32, lengths in arena units, "ahead" and "left" in the robot's frame.

    0:6     robot x, y, sin and cos of its angle, finger openings / (pi / 8)
    6:11    robot velocity ahead and left, turn rate, finger rates
    11:15   goal region: its centre ahead, left; half its width and height
    15:26   the current target: position of its centre ahead, left; sine and cosine of its angle against the robot's;
            velocity ahead, left; whether its centre is inside the region; its distance from the robot's centre and the
            direction towards it (ahead, left); its initial distance to the region's centre (`PhysicsState`)
    26:37   the other target, likewise
    37:38   1 if the current target is the first, else 0
    38:59   for each of the three distractors nearest to the robot, the first seven of these entries

The current target is the one outside the region, or the nearer one if both are inside or outside. What a policy learns
about bringing one target therefore holds for the other as well. All entries of an absent block are 0, but an absent
target counts as inside.
"""

import jax
import jax.numpy as jnp

from tasks.match_regions import geometry
from tasks.match_regions.layouts import COLOURS, NUM_TARGETS, blocks
from tasks.match_regions.model import FINGER_OPEN
from tasks.match_regions.state import PhysicsState, inside

SIZE = 59
TURN_RATE = 2.5
_DISTRACTORS = 3
# More than any distance in the arena.
_LAST = 10.0


def observe(state: PhysicsState, targets_in_order: bool = True) -> jax.Array:
    """The observation described in the module's docstring; without `targets_in_order` the first target comes first."""
    qpos, qvel, world = state.qpos, state.qvel, state.world
    frame = _frame(qpos)
    robot = jnp.concatenate([qpos[:2], jnp.sin(qpos[2:3]), jnp.cos(qpos[2:3]), qpos[3:5] / FINGER_OPEN])
    rates = jnp.concatenate([frame @ qvel[:2], qvel[2:3] / TURN_RATE, qvel[3:5]])
    low, high = geometry.region_corners(world.region)
    region = jnp.concatenate([frame @ (geometry.region_centre(world.region) - qpos[:2]), (high - low) / 2])

    per_block = _per_block(state, frame)
    within = per_block[:, 6:]
    distance = jnp.linalg.norm(per_block[:, :2], axis=-1)
    near = distance[:NUM_TARGETS, None]
    towards = per_block[:NUM_TARGETS, :2] / jnp.maximum(near, 1e-6)
    targets = jnp.concatenate([per_block[:NUM_TARGETS], near, towards, state.initial_distance[:, None]], axis=-1)
    order = jnp.arange(NUM_TARGETS)
    if targets_in_order:
        absent = ~world.present[:NUM_TARGETS]
        order = jnp.argsort(distance[:NUM_TARGETS] + _LAST * (within[:NUM_TARGETS, 0] + absent))
    first = (order[:1] == 0).astype(jnp.float32)
    others = jnp.where(world.present[:, None], per_block, 0.0)[NUM_TARGETS:]
    nearest = jnp.argsort(jnp.where(world.present, distance, _LAST)[NUM_TARGETS:])[:_DISTRACTORS]
    return jnp.concatenate([robot, rates, region, targets[order].ravel(), first, others[nearest].ravel()])


def observe_blocks(state: PhysicsState, moved: jax.Array) -> jax.Array:
    """Features of every block for policies that take blocks as a set, (M, 24) float32; all are 0 for an absent block.

        0       1
        1:8     the first seven entries of a block in the observation
        8:11    its distance from the robot's centre and the direction towards it (ahead, left)
        11:13   the region's centre from the block, ahead and left in the robot's frame
        13      1 for a target
        14      1 if the block counts as moved
        15:19   its shape, one-hot
        19:23   its colour, one-hot
        23      initial distance of a target to the region's centre

    Args:
      state: the physics state.
      moved: (M,) bool.
    """
    qpos, world = state.qpos, state.world
    frame = _frame(qpos)
    per_block = _per_block(state, frame)
    distance = jnp.linalg.norm(per_block[:, :2], axis=-1, keepdims=True)
    to_region = (geometry.region_centre(world.region)[None] - blocks(qpos)[:, :2]) @ frame.T
    target = (jnp.arange(world.present.shape[0]) < NUM_TARGETS).astype(jnp.float32)
    initial = jnp.zeros_like(target).at[:NUM_TARGETS].set(state.initial_distance)
    there = world.present[:, None]
    features = [
        there.astype(jnp.float32),
        per_block,
        distance,
        per_block[:, :2] / jnp.maximum(distance, 1e-6),
        to_region,
        jnp.stack([target, moved.astype(jnp.float32)], axis=-1),
        jax.nn.one_hot(world.shapes, len(geometry.SHAPES)),
        jax.nn.one_hot(world.colours, len(COLOURS)),
        initial[:, None],
    ]
    return jnp.where(there, jnp.concatenate(features, axis=-1), 0.0)


def _frame(qpos: jax.Array) -> jax.Array:
    """The matrix (2, 2) from arena coordinates to (ahead, left)."""
    ahead = geometry.heading(qpos[2])
    return jnp.stack([ahead, jnp.stack([-ahead[1], ahead[0]])])


def _per_block(state: PhysicsState, frame: jax.Array) -> jax.Array:
    """The first seven entries of every block, (M, 7); 0 for an absent one, which counts as inside."""
    qpos, world = state.qpos, state.world
    poses, there = blocks(qpos), world.present[:, None]
    position = (poses[:, :2] - qpos[None, :2]) @ frame.T
    angle = (poses[:, 2] - qpos[2])[:, None]
    velocity = blocks(state.qvel)[:, :2] @ frame.T
    within = (inside(qpos, world) | ~world.present)[:, None].astype(jnp.float32)
    per_block = jnp.where(there, jnp.concatenate([position, jnp.sin(angle), jnp.cos(angle), velocity], axis=-1), 0.0)
    return jnp.concatenate([per_block, within], axis=-1)
