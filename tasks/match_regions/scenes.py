"""Audit scenes of Match Regions: the Demo scene's blocks anywhere, with regions that the task draws.

Variants that change blocks use the same blocks here, so that audits of all variants are comparable.
"""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from graphrl_jax.reward.landscape import Grid, Landscape, Scenes
from tasks.match_regions import geometry, layouts
from tasks.match_regions.env import MatchRegionsEnv
from tasks.match_regions.layouts import NUM_TARGETS, Start, World, blocks
from tasks.match_regions.state import at_rest

RESOLUTION = 25
NUM_RANDOM, NUM_PAIRS = 512, 256
# Depth of a target inside the region's edge: just outside and some way inside.
_BESIDE, _WITHIN = -0.03, 0.1
_AXIS = np.linspace(-0.88, 0.88, RESOLUTION, dtype=np.float32)
_PLACES = np.stack(np.meshgrid(_AXIS, _AXIS), -1)
# Of every grid, the target that is moved, and whether the other one is placed.
_GRIDS = [(target, placed) for target in range(NUM_TARGETS) for placed in (False, True)]
_EDGE = ("within", "beside")
# Positions of placed targets, as shares of the region's sides.
_PLACED = np.array([[0.75, 0.29], [0.25, 0.79]], np.float32)


class _Drawn(NamedTuple):
    """Starts (K, ...) with their boxes (K, N, 4) and physics states."""

    start: Start
    boxes: Any
    states: Any

    def scenes(self, active: np.ndarray) -> Scenes:
        """Scenes of an audit with these slots active."""
        return Scenes(self.boxes, active, self.states)


def landscape(task: MatchRegionsEnv, key: jax.Array) -> Landscape:
    """Grids of either target (the other at its start or placed), random layouts, and pairs of layouts."""
    demo, mask, drawn, grids, random_distance = jax.tree.map(np.asarray, _draw(task, key))
    moved_at_edge = _moved(task) | _slots(task, drawn["within"].start.moved)
    return Landscape(
        objects=task.objects,
        mask=mask,
        grids=tuple(_grid(task, demo, grid, *which) for which, grid in zip(_GRIDS, grids, strict=True)),
        random_distance=random_distance,
        **{name: found.scenes(moved_at_edge if name in _EDGE else _moved(task)) for name, found in drawn.items()},
    )


@partial(jax.jit, static_argnums=0)
def _draw(task: MatchRegionsEnv, key: jax.Array) -> Any:
    """All that is random or computed, in one program: the demonstrated start and its mask, starts by the names of
    `Landscape`'s fields, those of every grid of `_GRIDS`, and the distances of the random ones.
    """
    demo_key, random_key, pair_key, edge_key = jax.random.split(key, 4)
    demo = _sample(task, demo_key)
    random = jax.vmap(partial(_scattered, task))(jax.random.split(random_key, NUM_RANDOM))
    finished, unfinished = jax.vmap(partial(_pair, task))(jax.random.split(pair_key, NUM_PAIRS))
    within, beside = jax.vmap(partial(_edge_pair, task))(jax.random.split(edge_key, NUM_PAIRS))
    starts = {"random": random, "finished": finished, "unfinished": unfinished, "within": within, "beside": beside}

    def look(start: Start) -> _Drawn:
        boxes, _ = jax.vmap(task.scene_boxes)(start.qpos, start.world)
        return _Drawn(start, boxes, jax.vmap(at_rest)(start.qpos, start.world))

    grids = [look(_over_arena(demo, *which)) for which in _GRIDS]
    mask = task.scene_boxes(demo.qpos, demo.world)[1]
    return demo, mask, {name: look(start) for name, start in starts.items()}, grids, jax.vmap(_distance)(random)


def _sample(task: MatchRegionsEnv, key: jax.Array) -> Start:
    """A start of the task, with the Demo scene's blocks."""
    start = task.layout.sample(key)
    if task.layout.fixed:
        return start
    world = layouts.demo_world(task.layout.blocks)._replace(region=start.world.region)
    # Blocks that the variant left out get their Demo places.
    known = blocks(start.qpos)[:5]
    missing = jnp.any(jnp.abs(known[:, :2]) > 1.0, axis=-1, keepdims=True)
    poses = blocks(start.qpos).at[:5].set(jnp.where(missing, layouts.BLOCK_STARTS, known))
    return layouts.begin(jnp.concatenate([start.qpos[None, :3], poses]), jax.tree.map(jnp.asarray, world))


def _moved(task: MatchRegionsEnv) -> np.ndarray:
    """Activity of robot and both targets, as at the end of a successful demonstration: (N,) bool."""
    return np.isin(np.arange(task.objects.num_slots), [1, 2, 3])


def _slots(task: MatchRegionsEnv, flags: np.ndarray) -> np.ndarray:
    """Flags (K, M) of blocks as flags of node slots: (K, N)."""
    return np.pad(flags, ((0, 0), (2, task.objects.num_slots - 2 - flags.shape[1])))


def _move(qpos: jax.Array, block: int | jax.Array, place: jax.Array) -> jax.Array:
    return jax.lax.dynamic_update_slice(qpos, place, (5 + 3 * block,))


def _within(world: World, share: jax.Array | np.ndarray) -> jax.Array:
    """The position in the region at a share (..., 2) of its sides."""
    low, high = (jnp.broadcast_to(corner, share.shape) for corner in geometry.region_corners(world.region))
    return low + share * (high - low)


def _scattered(task: MatchRegionsEnv, key: jax.Array) -> Start:
    """One of the task's scenes, with robot and blocks at random poses."""
    scene_key, place_key = jax.random.split(key)
    world = _sample(task, scene_key).world
    return layouts.begin(layouts.scatter(place_key, world.present), world)


def _distance(start: Start) -> jax.Array:
    """Summed distance of the targets outside the region to its centre: ()."""
    targets, region = blocks(start.qpos)[:NUM_TARGETS, :2], start.world.region
    way = jnp.linalg.norm(targets - geometry.region_centre(region)[None], axis=-1)
    return jnp.sum(way * ~geometry.inside_region(region, targets))


def _over_arena(demo: Start, target: int, other_placed: bool) -> Start:
    """The start `demo` with `target` moved over the arena, and the other target at its start or placed: (Y X, ...)."""
    other, qpos = 1 - target, demo.qpos
    if other_placed:
        qpos = _move(qpos, other, _within(demo.world, _PLACED[other]))
    moved = jax.vmap(partial(_move, qpos, target))(jnp.asarray(_PLACES.reshape(-1, 2)))
    return jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (len(moved), *leaf.shape)), demo)._replace(qpos=moved)


def _grid(task: MatchRegionsEnv, demo: Start, drawn: _Drawn, target: int, other_placed: bool) -> Grid:
    """The grid of `_over_arena`."""
    other, region = 1 - target, demo.world.region
    active = _moved(task)
    if not other_placed:
        active[2 + other] = False

    def as_grid(leaf: Any) -> Any:
        return leaf.reshape(RESOLUTION, RESOLUTION, *leaf.shape[1:])

    west, east, south, north = np.asarray(region)
    names = task.objects.names[2:4]
    return Grid(
        name=f"{names[target]} moved, {names[other]} {'placed' if other_placed else 'at its start'}",
        scenes=jax.tree.map(as_grid, drawn).scenes(active),
        x=_AXIS,
        y=_AXIS,
        inside=np.asarray(geometry.inside_region(region, jnp.asarray(_PLACES))),
        goal_outline=np.array([[west, south], [east, south], [east, north], [west, north]]),
        start=np.asarray(demo.homes[target]),
    )


def _pair(task: MatchRegionsEnv, key: jax.Array) -> tuple[Start, Start]:
    """A random layout with both targets inside, and the same with one of them (either) outside."""
    scene_key, start_key, finished_key, order_key = jax.random.split(key, 4)
    start = _scattered(task, scene_key)
    places = _within(start.world, jax.random.uniform(finished_key, (NUM_TARGETS, 2)))
    finished = _move(_move(start.qpos, 0, places[0]), 1, places[1])
    back = blocks(start.qpos)[:NUM_TARGETS, :2]
    # A random place inside the region would not be unfinished.
    homes = _sample(task, start_key).homes
    homes = jnp.where(geometry.inside_region(start.world.region, homes)[:, None], _beside(start.world), homes)
    back = jnp.where(geometry.inside_region(start.world.region, back)[:, None], homes, back)
    star = jax.random.bernoulli(order_key)
    unfinished = jnp.where(star, _move(finished, 0, back[0]), _move(finished, 1, back[1]))
    return start._replace(qpos=finished), start._replace(qpos=unfinished)


def _beside(world: World) -> jax.Array:
    """The corner of the arena furthest from the region: (2,)."""
    return -0.8 * jnp.where(geometry.region_centre(world.region) > 0, 1.0, -1.0)


def _edge_pair(task: MatchRegionsEnv, key: jax.Array) -> tuple[Start, Start]:
    """The robot, outside the region, holds a target inside the edge or beside it; the other target is placed.

    Distractors are anywhere and count as moved at random.
    """
    scene_key, target_key, place_key, side_key, along_key, active_key = jax.random.split(key, 6)
    start = _scattered(task, scene_key)
    target = jax.random.randint(target_key, (), 0, NUM_TARGETS)
    low, high = geometry.region_corners(start.world.region)
    low, high = low + _WITHIN, high - _WITHIN
    placed = jax.random.uniform(place_key, (2,), minval=low, maxval=high)
    along = jax.random.uniform(along_key, (2,), minval=low, maxval=high)
    side = jax.random.randint(side_key, (), 0, 4)
    outwards = jnp.array([[-1.0, 0.0], [1.0, 0.0], [0.0, -1.0], [0.0, 1.0]])[side]
    edge = jnp.where(outwards == 0, along, jnp.where(outwards < 0, low - _WITHIN, high + _WITHIN))

    def held(depth: float) -> jax.Array:
        place = edge - depth * outwards
        poses = blocks(start.qpos)
        poses = poses.at[:, :2].set(poses[:, :2].at[1 - target].set(placed).at[target].set(place))
        robot = jnp.append(place + layouts.HELD_REACH * outwards, jnp.arctan2(outwards[0], -outwards[1]))
        return layouts.pack(robot, start.qpos[3:5], poses)

    others = start.world.present & (jnp.arange(start.moved.shape[0]) >= NUM_TARGETS)
    start = start._replace(moved=jax.random.bernoulli(active_key, shape=others.shape) & others)
    return start._replace(qpos=held(_WITHIN)), start._replace(qpos=held(_BESIDE))
