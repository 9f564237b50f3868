"""Object tables: the fixed table of the Demo scene, and that of the variants, in which blocks change."""

import jax
import jax.numpy as jnp
import numpy as np

from graphrl_jax.graph import ObjectTable
from tasks.match_regions.geometry import SHAPES, block_boxes, box_corners, robot_box
from tasks.match_regions.layouts import COLOURS, GREEN, NUM_TARGETS, World, open_fingers, pack

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


def _looks(objects: ObjectTable) -> tuple[np.ndarray, np.ndarray]:
    """Colour and shape of the objects of every class, (C,) int32 each; 0 where a class has none."""
    found = np.zeros((2, objects.num_classes), np.int32)
    for number, name in enumerate(objects.class_names):
        colour, _, shape = name.partition("_")
        # The Demo scene's table does not name the colour of its region.
        found[0, number] = COLOURS.index(colour) if colour in COLOURS else GREEN
        found[1, number] = SHAPES.index(shape) if shape in SHAPES else 0
    return found[0], found[1]


def scene_of_boxes(
    objects: ObjectTable, boxes: jax.Array, mask: jax.Array, class_ids: jax.Array, turns: jax.Array
) -> tuple[jax.Array, World]:
    """A scene whose objects have these boxes, but for their sizes, which follow from classes and angles.

    Args:
      objects: `OBJECTS`, or a table of `variant_objects`.
      boxes: (N, 4) float32, image-plane boxes.
      mask: (N,) bool, objects that are there.
      class_ids: (N,) int32, their classes.
      turns: (N,) float32, angles in radians of the robot and the blocks.

    Returns:
      `qpos` (5 + 3M,), with open fingers, of the M slots after the robot's; and the scene's region and blocks.
    """
    colours, shapes = (jnp.asarray(looks)[class_ids] for looks in _looks(objects))
    low, high = box_corners(boxes)
    fingers, turned = open_fingers(), jnp.pad(turns[:, None], ((0, 0), (2, 0)))
    # Bodies are not in the middle of their boxes.
    at_origin = jnp.concatenate([robot_box(turned[1], fingers)[None], block_boxes(turned[2:], shapes[2:])])
    places = (low + high)[1:] / 2 - sum(box_corners(at_origin)) / 2
    poses = jnp.concatenate([places, turns[1:, None]], axis=-1)
    region = jnp.stack([low[0, 0], high[0, 0], low[0, 1], high[0, 1]])
    strengths = jnp.ones(5, jnp.float32)
    return pack(poses[0], fingers, poses[1:]), World(region, colours[0], colours[2:], shapes[2:], mask[2:], strengths)
