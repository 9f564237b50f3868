"""Where episodes start: distributions over `Start`, cheap enough to be drawn at every environment step."""

import math
from dataclasses import dataclass
from typing import NamedTuple, Protocol

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
_NONE_MOVED = np.zeros(5, bool)
# How far a bump shifts a distractor, a standard deviation in arena units.
_BUMP = 0.12


class Start(NamedTuple):
    """An initial configuration.

    | field | shape | dtype   | meaning                                               |
    |-------|-------|---------|-------------------------------------------------------|
    | qpos  | (20,) | float32 | see `env.PhysicsState`                                |
    | moved | (5,)  | bool    | blocks that count as moved before the episode begins |
    """

    qpos: jax.Array
    moved: jax.Array


class Layout(Protocol):
    """Draws initial configurations."""

    def sample(self, key: jax.Array) -> Start:
        """One of them."""
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

    def sample(self, key: jax.Array) -> Start:
        poses = jnp.concatenate([ROBOT_START[None], BLOCK_STARTS])
        poses = poses + jax.random.uniform(key, poses.shape, minval=-self.jitter, maxval=self.jitter)
        # A wide jitter must not push an object into the wall it starts beside.
        radii = jnp.array([ROBOT_RADIUS] + [BLOCK_SIZE] * 5)[:, None]
        places = jnp.clip(poses[:, :2], radii - ARENA_HALF, ARENA_HALF - radii)
        poses = jnp.concatenate([places, poses[:, 2:]], axis=-1)
        return Start(pack(poses[0], _open_fingers(), poses[1:]), jnp.asarray(_NONE_MOVED))


@dataclass(frozen=True)
class Jitter(Demo):
    """MAGICAL's Jitter variant: shifted by up to 0.05 of the arena's side, turned by up to 0.05 of a full turn."""

    jitter: float = 0.1

    def sample(self, key: jax.Array) -> Start:
        position_key, angle_key = jax.random.split(key)
        qpos, moved = Demo(self.jitter).sample(position_key)
        turn = jax.random.uniform(angle_key, (6,), minval=-0.1 * math.pi, maxval=0.1 * math.pi)
        return Start(qpos.at[jnp.array([2, 7, 10, 13, 16, 19])].add(turn), moved)


@dataclass(frozen=True)
class Random:
    """MAGICAL's Layout variant with the region left in place: robot and blocks anywhere, angles uniform.

    Free of overlap where six tries find such a place.
    """

    def sample(self, key: jax.Array) -> Start:
        place_key, angle_key = jax.random.split(key)
        radii = jnp.array([ROBOT_RADIUS] + [1.2 * BLOCK_SIZE] * 5)
        reach = (ARENA_HALF - radii)[:, None]
        places = jax.random.uniform(place_key, (_CANDIDATES, 6, 2), minval=-1.0, maxval=1.0) * reach
        gaps = jnp.linalg.norm(places[:, :, None] - places[:, None], axis=-1) - radii[:, None] - radii
        clearance = jnp.min(gaps + 10.0 * jnp.eye(6), axis=(1, 2))
        places = places[jnp.argmax(clearance)]
        angles = jax.random.uniform(angle_key, (6, 1), minval=-math.pi, maxval=math.pi)
        poses = jnp.concatenate([places, angles], axis=-1)
        return Start(pack(poses[0], _open_fingers(), poses[1:]), jnp.asarray(_NONE_MOVED))


@dataclass(frozen=True)
class Training:
    """What policies are trained on: the layout of interest, and starts part of the way to the goal.

    In a share `varied` of the episodes one target is in focus. It lies where the layout has it or anywhere, the other
    one where the layout has it or already inside the region, with equal chances; and the robot starts anywhere, in
    front of one of the two, or holding it, again with equal chances. In a share `bumped` of all episodes each
    distractor has been bumped or not, with equal chances, as happens on the way to such starts: without it, policies
    that bump distractors do not recognise what they learned from them. Knows nothing of demonstrations.
    """

    base: Layout
    varied: float = 0.7
    bumped: float = 0.5

    def sample(self, key: jax.Array) -> Start:
        base_key, random_key, share_key, focus_key, choice_key, place_key, robot_key, bump_key = jax.random.split(
            key, 8
        )
        (base, moved), (scattered, _) = self.base.sample(base_key), Random().sample(random_key)
        blocks, random_blocks = base[5:].reshape(5, 3), scattered[5:].reshape(5, 3)
        in_focus = jnp.arange(2) == jax.random.randint(focus_key, (), 0, 2)
        focus_anywhere, other_placed, at_focus = jax.random.bernoulli(choice_key, shape=(3,))

        west, east, south, north = geometry.REGION
        placed = jax.random.uniform(place_key, (2,), minval=jnp.array([west, south]), maxval=jnp.array([east, north]))
        replaced = jnp.where(in_focus[:, None], random_blocks[:2], random_blocks[:2].at[:, :2].set(placed))
        targets = jnp.where(jnp.where(in_focus, focus_anywhere, other_placed)[:, None], replaced, blocks[:2])
        robot, opening = _approach(robot_key, scattered[:3], jnp.where(in_focus[0] == at_focus, targets[0], targets[1]))
        varied = pack(robot, opening * scattered[3:5], jnp.concatenate([targets, blocks[2:]]))
        qpos = jnp.where(jax.random.uniform(share_key) < self.varied, varied, base)
        return _bump(bump_key, Start(qpos, moved), self.bumped)


def _bump(key: jax.Array, start: Start, share: float) -> Start:
    """With probability `share`, distractors shifted a little, each with equal chances; they count as moved."""
    episode_key, block_key, shift_key = jax.random.split(key, 3)
    bumped = jax.random.bernoulli(episode_key, share) & jax.random.bernoulli(block_key, shape=(5,))
    bumped = bumped & (jnp.arange(5) >= 2)
    blocks = start.qpos[5:].reshape(5, 3)
    reach = ARENA_HALF - BLOCK_SIZE
    places = jnp.clip(blocks[:, :2] + _BUMP * jax.random.normal(shift_key, (5, 2)), -reach, reach)
    blocks = blocks.at[:, :2].set(jnp.where(bumped[:, None], places, blocks[:, :2]))
    return Start(jnp.concatenate([start.qpos[:5], blocks.ravel()]), start.moved | bumped)


def _approach(key: jax.Array, robot: jax.Array, block: jax.Array) -> tuple[jax.Array, jax.Array]:
    """The robot (3,) where it is, facing the block (3,) from nearby, or holding it, and its fingers' opening ()."""
    kind_key, angle_key, distance_key, error_key = jax.random.split(key, 4)
    kind = jax.random.randint(kind_key, (), 0, 3)
    distance = jnp.where(kind == 1, jax.random.uniform(distance_key, minval=0.4, maxval=0.9), HELD_REACH)
    error = jnp.where(kind == 1, jax.random.uniform(error_key, minval=-0.5, maxval=0.5), 0.0)
    # Of a few directions the first that keeps the robot off the walls.
    angles = jax.random.uniform(angle_key, (_CANDIDATES,), minval=-math.pi, maxval=math.pi)
    places = block[:2] - distance * jax.vmap(geometry.heading)(angles)
    reach = ARENA_HALF - ROBOT_RADIUS
    first = jnp.argmax(jnp.max(jnp.abs(places), axis=-1) <= reach)
    pose = jnp.append(jnp.clip(places[first], -reach, reach), angles[first] + error)
    return jnp.where(kind == 0, robot, pose), jnp.where(kind == 2, HELD_OPENING / FINGER_OPEN, 1.0)
