"""Audit scenes of Shoes in Box."""

import jax
import jax.numpy as jnp
import numpy as np

from graphrl_jax.reward.landscape import Grid, Landscape, Scenes
from tasks.shoes_in_box import geometry, layouts
from tasks.shoes_in_box.kinematics import HOME
from tasks.shoes_in_box.model import INNER, LID_OPEN, SOLE
from tasks.shoes_in_box.objects import OBJECTS
from tasks.shoes_in_box.state import LID_COUNTS_AS_OPEN
from tasks.shoes_in_box.state import shoes as shoes_of

RESOLUTION = 25
NUM_RANDOM, NUM_PAIRS = 512, 256
# Area of the table where shoes may lie, and the distance that a shut lid adds to a scene, metres.
_TABLE = np.array([[0.25, -0.42], [0.62, 0.42]], np.float32)
_SHUT = 0.3
_ACTIVE = np.array([True, False, True, True, True])
_PLACED = np.array([[0.0, 0.07], [0.0, -0.07]], np.float32)
# Depth of a shoe inside the box's inner edge, along the hinge: some way inside and just outside.
_WITHIN, _BESIDE = 0.07, -0.06


def landscape(key: jax.Array) -> Landscape:
    """Grids of either shoe (the other at its start or in the box) with the lid open, random scenes, and pairs."""
    random_key, pair_key, edge_key = jax.random.split(key, 3)
    grids = tuple(_grid(shoe, placed) for shoe in range(2) for placed in (False, True))
    random, distance = _look(jax.vmap(_random)(jax.random.split(random_key, NUM_RANDOM)))
    finished, unfinished = jax.vmap(_pair)(jax.random.split(pair_key, NUM_PAIRS))
    within, beside = jax.vmap(_edge_pair)(jax.random.split(edge_key, NUM_PAIRS))
    return Landscape(
        objects=OBJECTS,
        mask=np.ones(OBJECTS.num_slots, bool),
        grids=grids,
        random=Scenes(random, _ACTIVE),
        random_distance=distance,
        finished=Scenes(_look(finished)[0], _ACTIVE),
        unfinished=Scenes(_look(unfinished)[0], _ACTIVE),
        within=Scenes(_look(within)[0], _ACTIVE),
        beside=Scenes(_look(beside)[0], _ACTIVE),
    )


Placement = tuple[jax.Array, jax.Array]
"""qpos (24,) and the box's (x, y, yaw)."""


@jax.jit
def _seen(scenes: Placement) -> Placement:
    """Boxes (M, 5, 4) and distances (M,) of scenes (M, ...): summed over outside shoes, plus `_SHUT` for a shut lid."""

    def look(qpos: jax.Array, box: jax.Array) -> Placement:
        places = shoes_of(qpos)[:, :3]
        outside = ~jax.vmap(lambda place: geometry.inside_box(box, place))(places)
        ways = jnp.linalg.norm(places[:, :2] - box[None, :2], axis=-1) * outside
        return geometry.boxes(qpos, box), ways.sum() + _SHUT * (qpos[9] < LID_COUNTS_AS_OPEN)

    return jax.vmap(look)(*scenes)


def _look(scenes: Placement) -> tuple[np.ndarray, np.ndarray]:
    boxes, distances = _seen(scenes)
    return np.asarray(boxes), np.asarray(distances)


def _scene(box: jax.Array, shoes: jax.Array, lid: jax.Array) -> Placement:
    return layouts.pack(jnp.asarray(HOME), lid, shoes), box


def _box(key: jax.Array) -> jax.Array:
    return layouts.Layout().sample(key)[1]


def _in_box(box: jax.Array, place: jax.Array) -> jax.Array:
    """(x, y, yaw) of a shoe in the box, at `place` (2,) in the box's frame."""
    return jnp.append(geometry.box_pose(box).place(jnp.append(place, SOLE[2]))[:2], box[2])


def _on_table(key: jax.Array, box: jax.Array) -> jax.Array:
    """Random (x, y, yaw) of a shoe on the table: the first of a few draws that is beside the box."""
    place_key, yaw_key = jax.random.split(key)
    places = jax.random.uniform(place_key, (8, 2), minval=_TABLE[0], maxval=_TABLE[1])
    beside = jnp.abs(places[:, 1] - box[1]) > INNER[1] + 0.1
    yaw = jax.random.uniform(yaw_key, minval=-jnp.pi / 2, maxval=jnp.pi / 2)
    return jnp.append(places[jnp.argmax(beside)], yaw)


def _random(key: jax.Array) -> Placement:
    """A random scene: lid open or shut, each shoe in the box (only if it is open) or on the table."""
    box_key, lid_key, inside_key, *shoe_keys = jax.random.split(key, 5)
    box = _box(box_key)
    opened = jax.random.bernoulli(lid_key, 0.7)
    inside = jax.random.bernoulli(inside_key, 0.3, (2,)) & opened
    placed = jnp.stack([_in_box(box, place) for place in _PLACED])
    lying = jnp.stack([_on_table(shoe_key, box) for shoe_key in shoe_keys])
    return _scene(box, jnp.where(inside[:, None], placed, lying), jnp.where(opened, LID_OPEN, 0.0))


def _pair(key: jax.Array) -> tuple[Placement, Placement]:
    """A scene with both shoes in the open box, and the same with one of them on the table."""
    box_key, shoe_key, which_key = jax.random.split(key, 3)
    box = _box(box_key)
    placed = jnp.stack([_in_box(box, place) for place in _PLACED])
    which = jax.random.randint(which_key, (), 0, 2)
    unfinished = placed.at[which].set(_on_table(shoe_key, box))
    opened = jnp.asarray(LID_OPEN)
    return _scene(box, placed, opened), _scene(box, unfinished, opened)


def _edge_pair(key: jax.Array) -> tuple[Placement, Placement]:
    """Scenes with one shoe in the open box: the other shoe is also in it, or just outside its nearer wall."""
    box_key, which_key = jax.random.split(key)
    box = _box(box_key)
    which = jax.random.randint(which_key, (), 0, 2)
    placed = jnp.stack([_in_box(box, place) for place in _PLACED])
    side = jnp.where(which == 0, 1.0, -1.0)

    def scene(depth: float) -> Placement:
        place = jnp.stack([0.0 * side, side * (INNER[1] - depth)])
        return _scene(box, placed.at[which].set(_in_box(box, place)), jnp.asarray(LID_OPEN))

    return scene(_WITHIN), scene(_BESIDE)


def _grid(shoe: int, other_placed: bool) -> Grid:
    """The default scene with open lid: one shoe is moved over the table, the other is at its start or in the box."""
    other = 1 - shoe
    box = jnp.asarray(layouts.BOX_START)
    shoes = jnp.asarray(layouts.SHOE_STARTS)
    if other_placed:
        shoes = shoes.at[other].set(_in_box(box, jnp.asarray(_PLACED[other])))
    x = np.linspace(*_TABLE[:, 0], RESOLUTION, dtype=np.float32)
    y = np.linspace(*_TABLE[:, 1], RESOLUTION, dtype=np.float32)
    places = np.stack(np.meshgrid(x, y), -1).reshape(-1, 2)
    scenes = jax.vmap(lambda place: _scene(box, shoes.at[shoe, :2].set(place), jnp.asarray(LID_OPEN)))(places)
    active = _ACTIVE.copy()
    active[3 + other] = other_placed
    west, east = box[0] - INNER[0], box[0] + INNER[0]
    south, north = box[1] - INNER[1], box[1] + INNER[1]
    inside = jax.vmap(lambda place: geometry.inside_box(box, jnp.append(place, SOLE[2])))(places)
    return Grid(
        name=f"shoe {shoe + 1} moved, shoe {other + 1} {'in the box' if other_placed else 'at its start'}",
        scenes=Scenes(_look(scenes)[0].reshape(RESOLUTION, RESOLUTION, OBJECTS.num_slots, 4), active),
        x=x,
        y=y,
        inside=np.asarray(inside).reshape(RESOLUTION, RESOLUTION),
        goal_outline=np.array([[west, south], [east, south], [east, north], [west, north]]),
        start=layouts.SHOE_STARTS[shoe, :2],
    )
