"""Where episodes start: distributions over `qpos` (20,), cheap enough to be drawn at every environment step."""

import math
from dataclasses import dataclass
from typing import Protocol

import jax
import jax.numpy as jnp
import numpy as np

from tasks.match_regions import geometry
from tasks.match_regions.model import ARENA_HALF, BLOCK_SIZE, FINGER_OPEN, ROBOT_RADIUS

ROBOT_START = np.array([-0.5, 0.1, -1.2 * math.pi], np.float32)
BLOCK_STARTS = np.array(
    [
        [0.8, -0.7, 2.37],
        [-0.68, 0.72, 1.28],
        [-0.05, -0.2, -1.09],
        [-0.75, -0.55, 2.78],
        [0.3, -0.82, -1.15],
    ],
    np.float32,
)
HELD_REACH = 0.325
HELD_OPENING = 0.2
_CANDIDATES = 6


class Layout(Protocol):
    """Draws initial configurations."""

    def sample(self, key: jax.Array) -> jax.Array:
        """One `qpos` (20,)."""
        ...


def pack(robot: jax.Array, fingers: jax.Array, blocks: jax.Array) -> jax.Array:
    """Joins robot pose (3,), finger angles (2,) and block poses (5, 3) to a `qpos` (20,)."""
    return jnp.concatenate([robot, fingers, blocks.ravel()])


def _open_fingers() -> jax.Array:
    return jnp.array([FINGER_OPEN, -FINGER_OPEN], jnp.float32)


@dataclass(frozen=True)
class Demo:
    """MAGICAL's demonstration layout, every pose shifted and turned uniformly by up to `jitter` units (radians)."""

    jitter: float = 0.03

    def sample(self, key: jax.Array) -> jax.Array:
        poses = jnp.concatenate([ROBOT_START[None], BLOCK_STARTS])
        poses = poses + jax.random.uniform(key, poses.shape, minval=-self.jitter, maxval=self.jitter)
        # A wide jitter must not push an object into the wall it starts beside.
        radii = jnp.array([ROBOT_RADIUS] + [BLOCK_SIZE] * 5)[:, None]
        places = jnp.clip(poses[:, :2], radii - ARENA_HALF, ARENA_HALF - radii)
        poses = jnp.concatenate([places, poses[:, 2:]], axis=-1)
        return pack(poses[0], _open_fingers(), poses[1:])


@dataclass(frozen=True)
class Jitter(Demo):
    """MAGICAL's Jitter variant: shifted by up to 0.05 of the arena's side, turned by up to 0.05 of a full turn."""

    jitter: float = 0.1

    def sample(self, key: jax.Array) -> jax.Array:
        position_key, angle_key = jax.random.split(key)
        qpos = Demo(self.jitter).sample(position_key)
        turn = jax.random.uniform(angle_key, (6,), minval=-0.1 * math.pi, maxval=0.1 * math.pi)
        return qpos.at[jnp.array([2, 7, 10, 13, 16, 19])].add(turn)


@dataclass(frozen=True)
class Random:
    """Robot and blocks anywhere, without overlap where six tries find such a place; angles uniform."""

    def sample(self, key: jax.Array) -> jax.Array:
        place_key, angle_key = jax.random.split(key)
        radii = jnp.array([ROBOT_RADIUS] + [1.2 * BLOCK_SIZE] * 5)
        reach = (ARENA_HALF - radii)[:, None]
        places = jax.random.uniform(place_key, (_CANDIDATES, 6, 2), minval=-1.0, maxval=1.0) * reach
        gaps = jnp.linalg.norm(places[:, :, None] - places[:, None], axis=-1) - radii[:, None] - radii
        clearance = jnp.min(gaps + 10.0 * jnp.eye(6), axis=(1, 2))
        places = places[jnp.argmax(clearance)]
        angles = jax.random.uniform(angle_key, (6, 1), minval=-math.pi, maxval=math.pi)
        poses = jnp.concatenate([places, angles], axis=-1)
        return pack(poses[0], _open_fingers(), poses[1:])


@dataclass(frozen=True)
class Training:
    """What policies are trained on: the layout of interest, and easier or more varied starts.

    A share `random` of the episodes starts with the robot anywhere; in these each target lies, with equal chance,
    where the layout has it, anywhere, or already inside the region; and in half of them the robot already holds one
    target that is not placed. Knows nothing of demonstrations.
    """

    base: Layout
    random: float = 0.6

    def sample(self, key: jax.Array) -> jax.Array:
        base_key, random_key, mix_key, goal_key, hold_key = jax.random.split(key, 5)
        base, scattered = self.base.sample(base_key), Random().sample(random_key)
        mix = jax.random.uniform(mix_key, (5,))
        base_blocks, random_blocks = base[5:].reshape(5, 3), scattered[5:].reshape(5, 3)

        where = mix[1:3, None]
        west, east, south, north = geometry.REGION
        placed = jax.random.uniform(goal_key, (2, 2), minval=jnp.array([west, south]), maxval=jnp.array([east, north]))
        placed = jnp.concatenate([placed, random_blocks[:2, 2:]], axis=-1)
        targets = jnp.where(where < 1 / 3, base_blocks[:2], jnp.where(where < 2 / 3, random_blocks[:2], placed))

        robot, fingers = scattered[:3], scattered[3:5]
        held = (jax.random.uniform(hold_key) < 0.5).astype(jnp.int32)
        holds = (mix[3] < 0.5) & (mix[1 + held] < 2 / 3)
        position = robot[:2] + HELD_REACH * geometry.heading(robot[2])
        holds &= jnp.all(jnp.abs(position) < ARENA_HALF - BLOCK_SIZE)
        targets = jnp.where(holds & (jnp.arange(2) == held)[:, None], jnp.append(position, robot[2]), targets)
        fingers = jnp.where(holds, HELD_OPENING / FINGER_OPEN, 1.0) * fingers

        varied = pack(robot, fingers, jnp.concatenate([targets, base_blocks[2:]]))
        return jnp.where(mix[0] < self.random, varied, base)
