"""Distributions of starts, cheap enough to be sampled at every environment step.

Symbols: M block slots, of which some may be empty. The first two are the targets.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import jax
import jax.numpy as jnp
import numpy as np

from tasks.match_regions import geometry
from tasks.match_regions.geometry import CIRCLE, PENTAGON, REGION, SQUARE, STAR
from tasks.match_regions.model import ARENA_HALF, BLOCK_REACH, BLOCK_SIZE, FINGER_OPEN, ROBOT_RADIUS

NUM_TARGETS = 2
COLOURS = ("red", "green", "blue", "yellow")
RED, GREEN, BLUE, YELLOW = range(4)
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
# Clear radius around the centres of blocks (for the star, the largest) and of the robot (with its fingers).
_CLEARANCE, _ROBOT_CLEARANCE = 1.25 * BLOCK_SIZE, 1.25 * ROBOT_RADIUS
# Standard deviation of the shift of a bumped distractor, in arena units.
_BUMP = 0.12


class World(NamedTuple):
    """Region, blocks and forces of an episode.

    | field         | shape | dtype   | meaning                                                                  |
    |---------------|-------|---------|--------------------------------------------------------------------------|
    | region        | (4,)  | float32 | goal region: x from, x to, y from, y to                                  |
    | region_colour | ()    | int32   | index into `COLOURS`                                                     |
    | colours       | (M,)  | int32   | colours of the blocks; targets have the region's colour                  |
    | shapes        | (M,)  | int32   | shapes of the blocks, index into `geometry.SHAPES`                       |
    | present       | (M,)  | bool    | the slot holds a block; the first slot always does                       |
    | strengths     | (5,)  | float32 | factors on the limits in `Physics`: drive force, turn torque, finger     |
    |               |       |         | torque, and force and torque of the dry friction under blocks            |
    """

    region: jax.Array
    region_colour: jax.Array
    colours: jax.Array
    shapes: jax.Array
    present: jax.Array
    strengths: jax.Array


class Start(NamedTuple):
    """An initial configuration.

    | field | shape     | dtype   | meaning                                                       |
    |-------|-----------|---------|---------------------------------------------------------------|
    | qpos  | (5 + 3M,) | float32 | see `state.PhysicsState`                                      |
    | moved | (M,)      | bool    | blocks that count as moved before the episode begins          |
    | homes | (2, 2)    | float32 | positions from which the targets count as brought             |
    | world |           |         | `World`                                                       |
    """

    qpos: jax.Array
    moved: jax.Array
    homes: jax.Array
    world: World


class Layout(Protocol):
    """A distribution of initial configurations.

    Attributes:
      blocks: M, the number of block slots.
      fixed: every episode has the blocks and forces of `demo_world`; only poses and the region may differ.
    """

    @property
    def blocks(self) -> int: ...

    @property
    def fixed(self) -> bool: ...

    def sample(self, key: jax.Array) -> Start:
        """A random start."""
        ...


def demo_world(blocks: int = 5) -> World:
    """The scene of MAGICAL's demonstrations, on the host; slots beyond its five blocks are empty."""
    return World(
        region=np.array(REGION, np.float32),
        region_colour=np.int32(GREEN),
        colours=np.resize(np.array([GREEN, GREEN, BLUE, YELLOW, YELLOW], np.int32), blocks),
        shapes=np.resize(np.array([STAR, SQUARE, PENTAGON, CIRCLE, PENTAGON], np.int32), blocks),
        present=np.arange(blocks) < 5,
        strengths=np.ones(5, np.float32),
    )  # type: ignore[arg-type]  # numpy arrays serve as JAX arrays


def pack(robot: jax.Array, fingers: jax.Array, blocks: jax.Array) -> jax.Array:
    """Joins robot pose (3,), finger angles (2,) and block poses (M, 3) to a `qpos` (5 + 3M,)."""
    return jnp.concatenate([robot, fingers, blocks.ravel()])


def blocks(qpos: jax.Array) -> jax.Array:
    """Poses x, y, theta of the blocks in `qpos` (5 + 3M,): (M, 3)."""
    return qpos[5:].reshape(-1, 3)


def open_fingers() -> jax.Array:
    """Angles of both fingers, open: (2,)."""
    return jnp.array([FINGER_OPEN, -FINGER_OPEN], jnp.float32)


def begin(poses: jax.Array, world: World) -> Start:
    """A start at poses (1 + M, 3) of robot and blocks; nothing has been moved."""
    moved = jnp.zeros(poses.shape[0] - 1, bool)
    return Start(pack(poses[0], open_fingers(), poses[1:]), moved, poses[1 : 1 + NUM_TARGETS, :2], world)


def jittered(key: jax.Array, poses: jax.Array, shift: jax.Array | float, turn: jax.Array | float) -> jax.Array:
    """Poses (K, 3) of the robot and blocks, each shifted by up to `shift` per axis and turned by up to `turn`."""
    limits = jnp.stack([shift, shift, turn])
    poses = poses + limits[None] * jax.random.uniform(key, poses.shape, minval=-1.0, maxval=1.0)
    # A wide jitter must not push an object into the wall it starts beside.
    reach = jnp.array([ARENA_HALF - ROBOT_RADIUS] + [BLOCK_REACH] * (poses.shape[0] - 1))[:, None]
    return jnp.concatenate([jnp.clip(poses[:, :2], -reach, reach), poses[:, 2:]], axis=-1)


def scatter(key: jax.Array, present: jax.Array, keep_clear: jax.Array | None = None) -> jax.Array:
    """Random poses (1 + M, 3) of the robot and of the blocks `present` (M,). Each in turn takes the first of a few
    random places that is clear of earlier ones (and of the region `keep_clear` (4,), if given), or the clearest place.
    Fingers are ignored: if they start in a wall or a block, contacts push them out.
    """
    place_key, angle_key = jax.random.split(key)
    number = 1 + present.shape[0]
    radii = jnp.array([_ROBOT_CLEARANCE] + [_CLEARANCE] * (number - 1))
    places = jax.random.uniform(place_key, (number, _CANDIDATES, 2), minval=-1.0, maxval=1.0)
    places = places * (ARENA_HALF - radii)[:, None, None]
    clear = jnp.full(places.shape[:2], jnp.inf)
    if keep_clear is not None:
        low, high = geometry.region_corners(keep_clear)
        clear = jnp.linalg.norm(places - jnp.clip(places, low[None, None], high[None, None]), axis=-1) - radii[:, None]
    there = jnp.append(True, present)

    def place(index: int, chosen: jax.Array) -> jax.Array:
        gaps = jnp.linalg.norm(places[index][:, None] - chosen[None], axis=-1) - radii[index] - radii[None]
        earlier = there & (jnp.arange(number) < index)
        free = jnp.minimum(jnp.min(jnp.where(earlier, gaps, jnp.inf), axis=1), clear[index])
        # The first place with a gap of at least 0, or the one with the largest gap.
        return chosen.at[index].set(places[index, jnp.argmax(jnp.minimum(free, 0.0))])

    chosen = jax.lax.fori_loop(0, number, place, jnp.zeros((number, 2)))
    angles = jax.random.uniform(angle_key, (number, 1), minval=-math.pi, maxval=math.pi)
    return jnp.concatenate([chosen, angles], axis=-1)


@dataclass(frozen=True)
class Demo:
    """MAGICAL's demonstration layout, every pose shifted and turned uniformly by up to `jitter` units (radians)."""

    jitter: float = 0.03
    blocks = 5
    fixed = True

    def sample(self, key: jax.Array) -> Start:
        poses = jnp.concatenate([ROBOT_START[None], BLOCK_STARTS])
        return begin(jittered(key, poses, self.jitter, self.jitter), jax.tree.map(jnp.asarray, demo_world()))


@dataclass(frozen=True)
class Training:
    """Starts for policy training: those of a base layout, and starts part of the way to the goal.

    In a share `varied` of the episodes one target is in focus. It is at its base place or anywhere, and the other
    target is at its base place or already inside the region, with equal probability. The robot starts anywhere, in
    front of one of the two, or holding it, also with equal probability. In a share `bumped` of all episodes each
    distractor is bumped with probability 1/2, as happens on the way to such starts. Otherwise a policy that bumps a
    distractor would be in a state unlike any start. Demonstrations are not used.
    """

    base: Layout
    varied: float = 0.7
    bumped: float = 0.5

    @property
    def blocks(self) -> int:
        return self.base.blocks

    @property
    def fixed(self) -> bool:
        return self.base.fixed

    def sample(self, key: jax.Array) -> Start:
        base_key, random_key, share_key, focus_key, choice_key, place_key, robot_key, bump_key = jax.random.split(
            key, 8
        )
        start = self.base.sample(base_key)
        world, poses = start.world, blocks(start.qpos)
        scattered = scatter(random_key, world.present)
        count = jnp.sum(world.present[:NUM_TARGETS])
        in_focus = jnp.arange(NUM_TARGETS) == jax.random.randint(focus_key, (), 0, count)
        focus_anywhere, other_placed, at_focus = jax.random.bernoulli(choice_key, shape=(3,))
        at_focus = at_focus | (count == 1)

        low, high = geometry.region_corners(jnp.clip(world.region, -BLOCK_REACH, BLOCK_REACH))
        placed = jax.random.uniform(place_key, (2,), minval=low, maxval=high)
        anywhere = scattered[1 : 1 + NUM_TARGETS]
        replaced = jnp.where(in_focus[:, None], anywhere, anywhere.at[:, :2].set(placed))
        replacing = jnp.where(in_focus, focus_anywhere, other_placed) & world.present[:NUM_TARGETS]
        targets = jnp.where(replacing[:, None], replaced, poses[:NUM_TARGETS])
        beside = jnp.where(in_focus[0] == at_focus, targets[0], targets[1])
        robot, opening = _approach(robot_key, scattered[0], beside)
        varied = pack(robot, opening * open_fingers(), poses.at[:NUM_TARGETS].set(targets))
        chosen = jax.random.uniform(share_key) < self.varied
        # A target that starts inside the region counts as brought from its base place.
        inside = geometry.inside_region(world.region, targets[:, :2])
        homes = jnp.where((chosen & ~inside)[:, None], targets[:, :2], start.homes)
        start = start._replace(qpos=jnp.where(chosen, varied, start.qpos), homes=homes)
        return _bump(bump_key, start, self.bumped)


def _bump(key: jax.Array, start: Start, share: float) -> Start:
    """With probability `share`, shifts each distractor a little with probability 1/2; shifted ones count as moved."""
    episode_key, block_key, shift_key = jax.random.split(key, 3)
    poses, present = blocks(start.qpos), start.world.present
    bumped = jax.random.bernoulli(episode_key, share) & jax.random.bernoulli(block_key, shape=present.shape)
    bumped = bumped & present & (jnp.arange(present.shape[0]) >= NUM_TARGETS)
    shift = _BUMP * jax.random.normal(shift_key, (present.shape[0], 2))
    places = jnp.clip(poses[:, :2] + shift, -BLOCK_REACH, BLOCK_REACH)
    poses = poses.at[:, :2].set(jnp.where(bumped[:, None], places, poses[:, :2]))
    qpos = pack(start.qpos[:3], start.qpos[3:5], poses)
    return start._replace(qpos=qpos, moved=start.moved | bumped)


def _approach(key: jax.Array, robot: jax.Array, block: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Robot pose (3,), unchanged, facing the block (3,) from nearby, or holding it, and the fingers' opening ()."""
    kind_key, angle_key, distance_key, error_key = jax.random.split(key, 4)
    kind = jax.random.randint(kind_key, (), 0, 3)
    distance = jnp.where(kind == 1, jax.random.uniform(distance_key, minval=0.4, maxval=0.9), HELD_REACH)
    error = jnp.where(kind == 1, jax.random.uniform(error_key, minval=-0.5, maxval=0.5), 0.0)
    # The first of a few directions that keeps the robot off the walls.
    angles = jax.random.uniform(angle_key, (_CANDIDATES,), minval=-math.pi, maxval=math.pi)
    places = block[None, :2] - distance * jax.vmap(geometry.heading)(angles)
    reach = ARENA_HALF - ROBOT_RADIUS
    first = jnp.argmax(jnp.max(jnp.abs(places), axis=-1) <= reach)
    pose = jnp.append(jnp.clip(places[first], -reach, reach), angles[first] + error)
    return jnp.where(kind == 0, robot, pose), jnp.where(kind == 2, HELD_OPENING / FINGER_OPEN, 1.0)
