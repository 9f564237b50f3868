"""Poses of objects in the world, and their image-plane boxes from exact silhouettes of all primitives.

A box projects to the hull of its corners, a capsule to the hull of its end spheres, and a sphere to an ellipse with an
extent in closed form. Occlusion is ignored here; it is part of the detector noise.
"""

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from tasks.shoes_in_box import kinematics, model

_CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float32)
_FOCAL = 0.5 / math.tan(math.radians(model.FIELD_OF_VIEW) / 2)


class Pose(NamedTuple):
    """A frame in the world: position (3,), rotation (3, 3)."""

    position: jax.Array
    rotation: jax.Array

    def place(self, points: jax.Array | np.ndarray) -> jax.Array:
        """World coordinates of points (..., 3) in this frame."""
        turned = points @ self.rotation.T
        return jnp.broadcast_to(self.position, turned.shape) + turned


def from_quaternion(q: jax.Array) -> jax.Array:
    """Rotation (3, 3) of a unit quaternion (4,), real part first."""
    w, x, y, z = q
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    return jnp.stack([jnp.stack(row) for row in rows])


def box_pose(box: jax.Array) -> Pose:
    """Frame of the box at (x, y, yaw)."""
    return Pose(jnp.append(box[:2], 0.0), kinematics.about(2, box[2]))


def lid_pose(box: jax.Array, angle: jax.Array) -> Pose:
    """Frame of the lid: at the hinge, with x from the bar towards the hinge."""
    carrier = box_pose(box)
    return Pose(carrier.place(jnp.array(model.HINGE)), carrier.rotation @ kinematics.about(1, angle))


def bar(box: jax.Array, angle: jax.Array) -> jax.Array:
    """Middle of the lid's bar: (3,)."""
    return lid_pose(box, angle).place(jnp.array([-model.BAR_REACH, 0.0, 0.0]))


def shoe_pose(qpos: jax.Array) -> Pose:
    """Frame of a shoe from its free joint (7,)."""
    return Pose(qpos[:3], from_quaternion(qpos[3:]))


def shoe_yaw(qpos: jax.Array) -> jax.Array:
    """Direction of a shoe's length, in (-pi / 2, pi / 2] because heel and toe look alike; ()."""
    w, x, y, z = qpos[3:]
    yaw = jnp.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return yaw - jnp.pi * jnp.round(yaw / jnp.pi)


def inside_box(box: jax.Array, point: jax.Array) -> jax.Array:
    """Whether a point (3,) is between the box's walls and below their top; () bool."""
    local = (point - box_pose(box).position) @ box_pose(box).rotation
    within = jnp.abs(local[:2]) < jnp.array(model.INNER)
    return within.all() & (local[2] < model.WALL_HEIGHT) & (local[2] > -0.01)


def boxes(qpos: jax.Array, box: jax.Array) -> jax.Array:
    """Image-plane boxes (5, 4) of gripper, box, lid and shoes, from `qpos` (24,) and the box's (x, y, yaw)."""
    tip, rotation, _, _ = kinematics.forward(qpos[:7])
    hand = Pose(tip - rotation[:, 2] * model.TCP_DISTANCE, rotation)
    lid, carrier = lid_pose(box, qpos[9]), box_pose(box)
    outer = jnp.array([model.INNER[0] + 2 * model.WALL, model.INNER[1] + 2 * model.WALL, model.WALL_HEIGHT / 2])
    lid_size = jnp.array([outer[0], outer[1], model.WALL / 2])
    bar_ends = jnp.array([[-model.BAR_REACH, side * model.BAR_HALF_LENGTH, 0.0] for side in (-1, 1)])
    upper = jnp.array([[side * model.UPPER_HALF_LENGTH, 0.0, model.UPPER_HEIGHT] for side in (-1, 1)])
    shoes = [
        _seen([_corners(shoe, np.zeros(3), model.SOLE)], shoe.place(upper), model.UPPER_RADIUS)
        for shoe in (shoe_pose(qpos[10:17]), shoe_pose(qpos[17:24]))
    ]
    return jnp.stack(
        [
            _seen_gripper(hand, qpos[7:9]),
            _seen([_corners(carrier, jnp.array([0.0, 0.0, model.WALL_HEIGHT / 2]), outer)]),
            _seen([_corners(lid, jnp.stack([-outer[0], 0.0, 0.0]), lid_size)], lid.place(bar_ends), model.BAR_RADIUS),
            *shoes,
        ]
    )


def depths(qpos: jax.Array, box: jax.Array) -> jax.Array:
    """Distances (5,) of the middles of gripper, box, lid and shoes from the camera, along its view axis."""
    lid, carrier = lid_pose(box, qpos[9]), box_pose(box)
    middles = jnp.stack(
        [
            kinematics.pose(qpos[:7])[:3],
            carrier.place(jnp.array([0.0, 0.0, model.WALL_HEIGHT / 2])),
            lid.place(jnp.array([-model.INNER[0], 0.0, 0.0])),
            qpos[10:13],
            qpos[17:20],
        ]
    )
    return -((middles - jnp.array(model.CAMERA)[None]) @ jnp.array(model.camera_axes()[2]))


def _seen_gripper(hand: Pose, openings: jax.Array) -> jax.Array:
    corners = [_corners(hand, np.array([0.0, 0.0, model.HAND_CENTRE]), model.HAND)]
    tips = []
    for sign, opening in ((1, openings[0]), (-1, openings[1])):
        for centre, size in (model.SHAFT, model.PAD):
            place = jnp.stack([centre[0], sign * (centre[1] + opening), model.FINGER_DISTANCE + centre[2]])
            corners.append(_corners(hand, place, size))
        tip = model.TIP_CENTRE
        tips.append(jnp.stack([tip[0], sign * (tip[1] + opening), model.FINGER_DISTANCE + tip[2]]))
    return _seen(corners, hand.place(jnp.stack(tips)), model.TIP_RADIUS)


def _corners(pose: Pose, centre: jax.Array | np.ndarray, size: jax.Array | tuple[float, ...]) -> jax.Array:
    return pose.place(centre[None] + _CORNERS * jnp.asarray(size)[None])


def _seen(corners: list[jax.Array], spheres: jax.Array | None = None, radius: float = 0.0) -> jax.Array:
    """The box (4,) around corners (8, 3) each and spheres (S, 3) of one radius."""
    points = jnp.concatenate(corners)
    low, high = _extent(points, 0.0)
    if spheres is not None:
        more_low, more_high = _extent(spheres, radius)
        low, high = jnp.concatenate([low, more_low]), jnp.concatenate([high, more_high])
    low, high = low.min(0), high.max(0)
    return jnp.concatenate([(low + high) / 2, high - low])


def _extent(points: jax.Array, radius: float) -> tuple[jax.Array, jax.Array]:
    """Least and greatest image coordinates of spheres around points (P, 3): two (P, 2)."""
    right, up, backward = (jnp.array(axis) for axis in model.camera_axes())
    offset = points - jnp.array(model.CAMERA)[None]
    depth = -(offset @ backward)[:, None]
    across = jnp.stack([offset @ right, -(offset @ up)], axis=-1)
    # Tangents from the camera's centre to a circle of this radius.
    reach = radius * jnp.sqrt(across**2 + depth**2 - radius**2)
    scale = _FOCAL / (depth**2 - radius**2)
    return 0.5 + scale * (across * depth - reach), 0.5 + scale * (across * depth + reach)
