"""Images of Match Regions from above, drawn in JAX: the input of a pixel encoder at every environment step.

Colours are MAGICAL's; outlines, the robot's eyes and the region's dashes are left out. Objects are drawn by the signed
distance of pixels to their edges, so that edges are smooth over a pixel and all pixels are drawn at once.
"""

import math

import jax
import jax.numpy as jnp
import numpy as np

from tasks.match_regions import geometry
from tasks.match_regions.layouts import World, blocks
from tasks.match_regions.model import ARENA_HALF, BLOCK_SIZE, FINGER_HALF_THICKNESS, ROBOT_RADIUS

_BLOCKS = np.array([[245, 129, 165], [195, 208, 130], [135, 185, 211], [254, 213, 123]], np.float32) / 255
_REGIONS = np.array([[250, 191, 209], [224, 231, 191], [194, 219, 233], [254, 234, 188]], np.float32) / 255
_ROBOT = np.array([162, 163, 175], np.float32) / 255
_WALL = np.array([231, 231, 234], np.float32) / 255
# One colour for fill and outline of a finger, which is two pixels wide.
_FINGER = np.array([198, 199, 206], np.float32) / 255

# Number of tips, and distances of tips and of the dents between them from the centre; a circle has neither.
_TIPS = {geometry.STAR: 5, geometry.SQUARE: 4, geometry.PENTAGON: 5}
_RADII = {
    geometry.STAR: (geometry.STAR_OUTER, geometry.STAR_INNER),
    geometry.SQUARE: (geometry.SQUARE_CIRCUMRADIUS, geometry.SQUARE_CIRCUMRADIUS * math.cos(math.pi / 4)),
    geometry.PENTAGON: (geometry.PENTAGON_CIRCUMRADIUS, geometry.PENTAGON_CIRCUMRADIUS * math.cos(math.pi / 5)),
}


def _edges() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Per shape: directions of its tips (4, 5, 2), and the line from a tip (on the first axis) to the next dent: its
    normal (4, 2) and its distance from the centre (4,).
    """
    directions, normals, offsets = np.zeros((4, 5, 2)), np.zeros((4, 2)), np.zeros(4)
    for shape, tips in _TIPS.items():
        phase = math.pi / 4 if shape == geometry.SQUARE else math.pi / 2
        angles = phase + np.arange(5) % tips * 2 * math.pi / tips
        directions[shape] = np.stack([np.cos(angles), np.sin(angles)], -1)
        outer, inner = _RADII[shape]
        dent = inner * np.array([math.cos(math.pi / tips), math.sin(math.pi / tips)])
        along = dent - [outer, 0.0]
        normals[shape] = np.array([along[1], -along[0]]) / np.hypot(*along)
        offsets[shape] = normals[shape, 0] * outer
    return directions.astype(np.float32), normals.astype(np.float32), offsets.astype(np.float32)


_DIRECTIONS, _NORMALS, _OFFSETS = _edges()


def image(qpos: jax.Array, world: World, size: int) -> jax.Array:
    """Image of the scene from above.

    Args:
      qpos: (5 + 3M,) configuration, see `state.PhysicsState`.
      world: region and blocks.
      size: pixels along an edge (static); the image spans [-1.02, 1.02]^2, y up.

    Returns:
      (size, size, 3) float32 in [0, 1].
    """
    pixel = 2 * geometry.VIEW_HALF / size
    axis = (jnp.arange(size) + 0.5) * pixel - geometry.VIEW_HALF
    x, y = axis[None, :], -axis[:, None]
    image = jnp.ones((size, size, 3))

    def paint(image: jax.Array, distance: jax.Array, colour: jax.Array | np.ndarray) -> jax.Array:
        covered = jnp.clip(0.5 - distance / pixel, 0.0, 1.0)
        return image + covered[..., None] * (jnp.broadcast_to(colour, image.shape) - image)

    image = paint(image, ARENA_HALF - jnp.maximum(jnp.abs(x), jnp.abs(y)), _WALL)
    low, high = geometry.region_corners(world.region)
    region = jnp.maximum(jnp.maximum(low[0] - x, x - high[0]), jnp.maximum(low[1] - y, y - high[1]))
    image = paint(image, region, jnp.asarray(_REGIONS)[world.region_colour])
    image = paint(image, _fingers(qpos[:3], qpos[3:5], x, y), _FINGER)
    image = paint(image, jnp.hypot(x - qpos[0], y - qpos[1]) - ROBOT_RADIUS, _ROBOT)
    poses = blocks(qpos)
    for block in range(poses.shape[0]):
        distance = _block(poses[block], world.shapes[block], x, y)
        distance = jnp.where(world.present[block], distance, jnp.inf)
        image = paint(image, distance, jnp.asarray(_BLOCKS)[world.colours[block]])
    return image


def _block(pose: jax.Array, shape: jax.Array, x: jax.Array, y: jax.Array) -> jax.Array:
    """Distance of points to a block's edge, negative inside; by symmetry only the nearest tip is considered."""
    turned = jnp.asarray(_DIRECTIONS)[shape] @ geometry.rotation(pose[2]).T
    x, y = x - pose[0], y - pose[1]
    square = x**2 + y**2
    along = turned[0, 0] * x + turned[0, 1] * y
    for direction in turned[1:]:
        along = jnp.maximum(along, direction[0] * x + direction[1] * y)
    aside = jnp.sqrt(jnp.maximum(square - along**2, 0.0))
    normal = jnp.asarray(_NORMALS)[shape]
    polygon = normal[0] * along + normal[1] * aside - jnp.asarray(_OFFSETS)[shape]
    return jnp.where(shape == geometry.CIRCLE, jnp.sqrt(square) - BLOCK_SIZE, polygon)


def _fingers(pose: jax.Array, fingers: jax.Array, x: jax.Array, y: jax.Array) -> jax.Array:
    """Distance of points to the edge of both fingers, negative inside."""
    points = geometry.finger_points(fingers) @ geometry.rotation(pose[2]).T + pose[None, None, :2]
    found = jnp.inf
    for finger in points:
        for start, end in ((finger[0], finger[1]), (finger[1], finger[2])):
            way, dx, dy = end - start, x - start[0], y - start[1]
            share = jnp.clip((dx * way[0] + dy * way[1]) / (way @ way), 0.0, 1.0)
            found = jnp.minimum(found, (dx - share * way[0]) ** 2 + (dy - share * way[1]) ** 2)
    return jnp.sqrt(found) - FINGER_HALF_THICKNESS
