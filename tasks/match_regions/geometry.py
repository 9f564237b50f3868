"""Outlines of the objects and their tight image-plane boxes.

The image spans [-1.02, 1.02]^2 of the arena; x runs right, y down. Blocks have the area of a disc of radius
`BLOCK_SIZE`, except the star, which has an outer radius of 1.3 `BLOCK_SIZE` (as MAGICAL draws them).
"""

import math

import jax
import jax.numpy as jnp
import numpy as np

from tasks.match_regions.model import (
    BLOCK_SIZE,
    FINGER_BEND,
    FINGER_HALF_THICKNESS,
    FINGER_HINGE,
    FINGER_LOWER,
    FINGER_UPPER,
    ROBOT_RADIUS,
)

VIEW_HALF = 1.02
DRAWN_LOWER = FINGER_LOWER - FINGER_HALF_THICKNESS
"""Axis length of the drawn lower finger. MAGICAL's length includes the rounded end; the collision shape adds it."""
REGION = (0.1, 0.7, 0.0, 0.7)
"""Goal region of the Demo layout: x from, x to, y from, y to in arena units, like every region (4,)."""
SHAPES = ("star", "square", "pentagon", "circle")
STAR, SQUARE, PENTAGON, CIRCLE = range(4)

SQUARE_CIRCUMRADIUS = BLOCK_SIZE * math.sqrt(math.pi / 2)
PENTAGON_CIRCUMRADIUS = BLOCK_SIZE * math.sqrt(math.pi / (2.5 * math.sin(2 * math.pi / 5)))
STAR_OUTER, STAR_INNER = 1.3 * BLOCK_SIZE, 0.65 * BLOCK_SIZE
_MAX_VERTICES = 5


def _polygon(sides: int, radius: float, phase: float) -> np.ndarray:
    """Corners, repeated to `_MAX_VERTICES` so that all blocks have the same number: (5, 2)."""
    angles = phase + np.arange(_MAX_VERTICES) % sides * 2 * math.pi / sides
    return radius * np.stack([np.cos(angles), np.sin(angles)], -1)


# The box of a star is the box of its five outer points.
_CORNERS = np.stack(
    [
        _polygon(5, STAR_OUTER, math.pi / 2),
        _polygon(4, SQUARE_CIRCUMRADIUS, math.pi / 4),
        _polygon(5, PENTAGON_CIRCUMRADIUS, math.pi / 2),
        np.zeros((_MAX_VERTICES, 2)),
    ]
).astype(np.float32)
_ROUNDING = np.array([0, 0, 0, BLOCK_SIZE], np.float32)


def rotation(theta: jax.Array) -> jax.Array:
    """Counter-clockwise rotation by `theta` () radians: (2, 2)."""
    cosine, sine = jnp.cos(theta), jnp.sin(theta)
    return jnp.array([[cosine, -sine], [sine, cosine]])


def heading(theta: jax.Array) -> jax.Array:
    """Unit vector in the robot's direction at angle `theta` (): (2,). MAGICAL's robot faces up at angle 0."""
    return jnp.stack([-jnp.sin(theta), jnp.cos(theta)])


def region_centre(region: jax.Array) -> jax.Array:
    """Centre of a region (4,): (2,)."""
    return jnp.stack([region[0] + region[1], region[2] + region[3]]) / 2


def region_corners(region: jax.Array) -> tuple[jax.Array, jax.Array]:
    """South-western and north-eastern corner of a region (4,): (2,) each."""
    return jnp.stack([region[0], region[2]]), jnp.stack([region[1], region[3]])


def inside_region(region: jax.Array, positions: jax.Array) -> jax.Array:
    """Whether points (..., 2) lie in a region (4,): (...,) bool."""
    low, high = (jnp.broadcast_to(corner, positions.shape) for corner in region_corners(region))
    return jnp.all((positions >= low) & (positions <= high), axis=-1)


def finger_points(fingers: jax.Array) -> jax.Array:
    """Hinge, elbow and tip of the left, then the right finger in the robot's frame: (2, 3, 2).

    `fingers` (2,) are the joint angles; open is +pi/8 on the left and -pi/8 on the right.
    """

    def one(sign: float, angle: jax.Array) -> jax.Array:
        tip = [-sign * DRAWN_LOWER * math.sin(FINGER_BEND), FINGER_UPPER + DRAWN_LOWER * math.cos(FINGER_BEND)]
        points = jnp.array([[0.0, 0.0], [0.0, FINGER_UPPER], tip])
        return points @ rotation(angle).T + jnp.array([[sign * FINGER_HINGE[0], FINGER_HINGE[1]]])

    return jnp.stack([one(-1.0, fingers[0]), one(1.0, fingers[1])])


def _box(points: jax.Array, radii: jax.Array) -> jax.Array:
    """Tight box in image coordinates around discs at `points` (P, 2) of `radii` (P,): cx, cy, w, h (4,)."""
    low = jnp.min(points - radii[:, None], axis=0)
    high = jnp.max(points + radii[:, None], axis=0)
    centre, size = (low + high) / 2, high - low
    return jnp.stack([VIEW_HALF + centre[0], VIEW_HALF - centre[1], size[0], size[1]]) / (2 * VIEW_HALF)


def robot_box(pose: jax.Array, fingers: jax.Array) -> jax.Array:
    """Box of the robot with its fingers: `pose` (3,) is x, y, theta, `fingers` (2,) their angles; (4,)."""
    points = jnp.concatenate([jnp.zeros((1, 2)), finger_points(fingers).reshape(-1, 2)])
    radii = jnp.full(points.shape[0], FINGER_HALF_THICKNESS).at[0].set(ROBOT_RADIUS)
    return _box(points @ rotation(pose[2]).T + pose[None, :2], radii)


def block_boxes(poses: jax.Array, shapes: jax.Array) -> jax.Array:
    """Boxes of blocks at `poses` (M, 3), x, y, theta each, whose `shapes` (M,) index `SHAPES`: (M, 4)."""

    def one(pose: jax.Array, corners: jax.Array, rounding: jax.Array) -> jax.Array:
        points = corners @ rotation(pose[2]).T + pose[None, :2]
        return _box(points, jnp.full(_MAX_VERTICES, rounding))

    return jax.vmap(one)(poses, jnp.asarray(_CORNERS)[shapes], jnp.asarray(_ROUNDING)[shapes])


def box_corners(boxes: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Lower left and upper right corners (..., 2) in the arena of boxes (..., 4) in image coordinates."""
    centre = VIEW_HALF * jnp.stack([2 * boxes[..., 0] - 1, 1 - 2 * boxes[..., 1]], axis=-1)
    half = boxes[..., 2:] * VIEW_HALF
    return centre - half, centre + half


def region_box(region: jax.Array) -> jax.Array:
    """Box of a region (4,): (4,)."""
    return _box(jnp.stack(region_corners(region)), jnp.zeros(2))


def outline(shape: int) -> np.ndarray:
    """Corners of a shape's drawn outline in its own frame, for drawings: (V, 2)."""
    if shape == CIRCLE:
        angles = np.linspace(0, 2 * math.pi, 32, endpoint=False)
        return BLOCK_SIZE * np.stack([np.cos(angles), np.sin(angles)], -1)
    if shape == STAR:
        angles = math.pi / 2 + np.arange(10) * math.pi / 5
        radii = np.where(np.arange(10) % 2, STAR_INNER, STAR_OUTER)[:, None]
        return radii * np.stack([np.cos(angles), np.sin(angles)], -1)
    return _CORNERS[shape][: 4 if shape == SQUARE else 5]
