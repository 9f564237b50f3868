"""Object tables: the fixed table of the Demo scene, and that of the variants, in which blocks change."""

import jax
import jax.numpy as jnp

from graphrl_jax.graph import ObjectTable
from tasks.match_regions.geometry import SHAPES
from tasks.match_regions.layouts import COLOURS, NUM_TARGETS, World

CLASS_NAMES = (
    "goal_region", "robot", "green_star", "green_square", "blue_pentagon", "yellow_circle", "yellow_pentagon",
)  # fmt: skip
OBJECTS = ObjectTable(
    names=("goal_region", "robot", "star", "square", "blue_pentagon", "yellow_circle", "yellow_pentagon", "spare"),
    class_ids=(0, 1, 2, 3, 4, 5, 6, 0),
    is_robot=(False, True) + (False,) * 6,
    class_names=CLASS_NAMES,
    is_fixture=(True,) + (False,) * 7,
)
"""Object table of the Demo scene."""

_REGIONS, _ROBOT, _BLOCKS = 0, len(COLOURS), len(COLOURS) + 1
_CLASS_NAMES = (
    *(f"{colour}_region" for colour in COLOURS),
    "robot",
    *(f"{colour}_{shape}" for colour in COLOURS for shape in SHAPES),
)
_NAMES = ("goal_region", "robot", *(f"target_{i + 1}" for i in range(NUM_TARGETS)))


def variant_objects(blocks: int) -> ObjectTable:
    """The object table for scenes of `blocks` block slots; its class ids are those of the Demo scene."""
    demo = ("green_region", "robot", *CLASS_NAMES[2:])
    classes = [_CLASS_NAMES.index(name) for name in (*demo, *demo[2:])][: 2 + blocks]
    return ObjectTable(
        names=(*_NAMES, *(f"distractor_{i + 1}" for i in range(blocks - NUM_TARGETS))),
        class_ids=tuple(classes),
        is_robot=(False, True) + (False,) * blocks,
        class_names=_CLASS_NAMES,
        is_fixture=(True, False) + (False,) * blocks,
    )


def class_ids(world: World) -> jax.Array:
    """Class of the object in each slot of `variant_objects` in an episode: (2 + M,) int32."""
    blocks = _BLOCKS + len(SHAPES) * world.colours + world.shapes
    return jnp.concatenate([jnp.stack([_REGIONS + world.region_colour, jnp.int32(_ROBOT)]), blocks])
