"""Scenes of Match Regions on which a learned reward is audited."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from graphrl_jax.landscape import Grid, Landscape
from tasks.match_regions import env, geometry, layouts

RESOLUTION = 25
NUM_RANDOM, NUM_PAIRS = 512, 256
# Objects that count as moved: robot and both targets, as in every demonstration once a target is placed.
_ACTIVE = np.array([False, True, True, True, False, False, False, False])
_DISTRACTOR = np.array([False, False, False, False, True, True, True, False])
# Of a target from the region's edge, just outside and some way inside.
_BESIDE, _WITHIN = -0.03, 0.1
_PLACED = np.array([[0.55, 0.2], [0.25, 0.55]], np.float32)


def landscape(key: jax.Array) -> Landscape:
    """Grids of either target (the other at its start or placed), random layouts, finished against unfinished ones."""
    random_key, robot_key, finished_key, order_key, edge_key = jax.random.split(key, 5)
    grids = tuple(_grid(target, placed) for target in range(env.NUM_TARGETS) for placed in (False, True))
    scenes = jax.vmap(layouts.Random().sample)(jax.random.split(random_key, NUM_RANDOM)).qpos
    targets = jax.vmap(lambda qpos: env.blocks(qpos)[: env.NUM_TARGETS, :2])(scenes)
    outside = ~geometry.inside_region(targets)
    distance = jnp.sum(jnp.linalg.norm(targets - geometry.region_centre(), axis=-1) * outside, axis=-1)
    finished, unfinished = _pairs(robot_key, finished_key, order_key)
    within, beside, edge_active = _edge_pairs(edge_key)
    return Landscape(
        objects=env.OBJECTS,
        mask=np.asarray(env.boxes(scenes[0])[1]),
        grids=grids,
        random_boxes=_boxes(scenes),
        random_active=np.broadcast_to(_ACTIVE, (NUM_RANDOM, env.OBJECTS.num_slots)),
        random_distance=np.asarray(distance),
        finished_boxes=_boxes(finished),
        unfinished_boxes=_boxes(unfinished),
        pair_active=_ACTIVE,
        within_boxes=_boxes(within),
        beside_boxes=_boxes(beside),
        edge_active=np.asarray(edge_active),
    )


def _boxes(qpos: jax.Array) -> np.ndarray:
    return np.asarray(jax.jit(jax.vmap(lambda scene: env.boxes(scene)[0]))(qpos))


def _move(qpos: jax.Array, block: int, place: jax.Array) -> jax.Array:
    return qpos.at[5 + 3 * block : 7 + 3 * block].set(place)


def _grid(target: int, other_placed: bool) -> Grid:
    """The scene of the demonstrations with `target` moved over the arena and the other at its start or placed."""
    other = 1 - target
    qpos = layouts.Demo(jitter=0.0).sample(jax.random.key(0)).qpos
    if other_placed:
        qpos = _move(qpos, other, jnp.asarray(_PLACED[other]))
    axis = np.linspace(-0.88, 0.88, RESOLUTION, dtype=np.float32)
    places = np.stack(np.meshgrid(axis, axis), -1)
    scenes = jax.vmap(partial(_move, qpos, target))(jnp.asarray(places.reshape(-1, 2)))
    active = _ACTIVE.copy()
    if not other_placed:
        active[2 + other] = False
    west, east, south, north = geometry.REGION
    names = ("star", "square")
    return Grid(
        name=f"{names[target]} moved, {names[other]} {'placed' if other_placed else 'at its start'}",
        boxes=_boxes(scenes).reshape(RESOLUTION, RESOLUTION, env.OBJECTS.num_slots, 4),
        active=active,
        x=axis,
        y=axis,
        inside=np.asarray(geometry.inside_region(jnp.asarray(places))),
        goal_outline=np.array([[west, south], [east, south], [east, north], [west, north]]),
        start=layouts.BLOCK_STARTS[target, :2],
    )


def _pairs(robot_key: jax.Array, finished_key: jax.Array, order_key: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Random layouts with both targets inside, and the same with one target (either) back at its random place."""
    scenes = jax.vmap(layouts.Random().sample)(jax.random.split(robot_key, NUM_PAIRS)).qpos
    west, east, south, north = geometry.REGION
    low, high = jnp.array([west, south]), jnp.array([east, north])
    places = jax.random.uniform(finished_key, (NUM_PAIRS, env.NUM_TARGETS, 2), minval=low, maxval=high)
    moved = jax.random.bernoulli(order_key, shape=(NUM_PAIRS,))

    def pair(qpos: jax.Array, place: jax.Array, star: jax.Array) -> tuple[jax.Array, jax.Array]:
        finished = _move(_move(qpos, 0, place[0]), 1, place[1])
        # A random place that happens to lie inside would not be unfinished.
        back = env.blocks(qpos)[: env.NUM_TARGETS, :2]
        back = jnp.where(geometry.inside_region(back)[:, None], jnp.asarray(layouts.BLOCK_STARTS[:2, :2]), back)
        return finished, jnp.where(star, _move(finished, 0, back[0]), _move(finished, 1, back[1]))

    return jax.jit(jax.vmap(pair))(scenes, places, moved)


def _edge_pairs(key: jax.Array) -> tuple[jax.Array, jax.Array, jax.Array]:
    """The robot holds a target within the region or beside it, from outside; the other one is placed.

    Distractors lie anywhere and count as moved or not.

    Returns:
      two batches of qpos, and which slots are active.
    """
    scene_key, key = jax.random.split(key)
    scenes = jax.vmap(layouts.Random().sample)(jax.random.split(scene_key, NUM_PAIRS)).qpos
    west, east, south, north = geometry.REGION

    def pair(key: jax.Array, qpos: jax.Array) -> tuple[jax.Array, jax.Array, jax.Array]:
        target_key, place_key, side_key, along_key, active_key = jax.random.split(key, 5)
        target = jax.random.randint(target_key, (), 0, env.NUM_TARGETS)
        low, high = jnp.array([west, south]) + _WITHIN, jnp.array([east, north]) - _WITHIN
        placed = jax.random.uniform(place_key, (2,), minval=low, maxval=high)
        along = jax.random.uniform(along_key, (2,), minval=low, maxval=high)
        side = jax.random.randint(side_key, (), 0, 4)
        outwards = jnp.array([[-1.0, 0.0], [1.0, 0.0], [0.0, -1.0], [0.0, 1.0]])[side]
        edge = jnp.where(outwards == 0, along, jnp.where(outwards < 0, low - _WITHIN, high + _WITHIN))

        def held(depth: float) -> jax.Array:
            place = edge - depth * outwards
            blocks = env.blocks(qpos)
            blocks = blocks.at[:, :2].set(blocks[:, :2].at[1 - target].set(placed).at[target].set(place))
            robot = jnp.append(place + layouts.HELD_REACH * outwards, jnp.arctan2(outwards[0], -outwards[1]))
            return layouts.pack(robot, qpos[3:5], blocks)

        bumped = jax.random.bernoulli(active_key, shape=_ACTIVE.shape) & _DISTRACTOR
        return held(_WITHIN), held(_BESIDE), _ACTIVE | bumped

    return jax.jit(jax.vmap(pair))(jax.random.split(key, NUM_PAIRS), scenes)
