"""The arm's forward kinematics and a step of differential inverse kinematics, in a few small matrix products.

The gripper always points down; its pose is (x, y, z, yaw). At yaw 0 the pads close along the world's y axis.
"""

import math

import jax
import jax.numpy as jnp
import numpy as np

from tasks.shoes_in_box.model import FLANGE, HAND_TURN, JOINT_RANGES, LINK_FRAMES, TCP_DISTANCE

HOME = np.array([0.0, -0.45, 0.0, -2.35, 0.0, 1.9, -math.pi / 4], np.float32)
"""Home joints: the gripper above the box, with pads that close along x (yaw pi / 2)."""
_LOW, _HIGH = (np.array(limits, np.float32) for limits in zip(*JOINT_RANGES, strict=True))
_MARGIN = 0.05
_DAMPING = 0.02
_TO_HOME = 0.02


def about(axis: int, angle: jax.Array) -> jax.Array:
    """Rotation by `angle` about the x (0), y (1) or z (2) axis: (3, 3)."""
    one, zero, c, s = jnp.ones_like(angle), jnp.zeros_like(angle), jnp.cos(angle), jnp.sin(angle)
    rows = (
        ((one, zero, zero), (zero, c, -s), (zero, s, c)),
        ((c, zero, s), (zero, one, zero), (-s, zero, c)),
        ((c, -s, zero), (s, c, zero), (zero, zero, one)),
    )
    return jnp.stack([jnp.stack(row) for row in rows[axis]])


def forward(joints: jax.Array) -> tuple[jax.Array, jax.Array, jax.Array, jax.Array]:
    """Point between the pads (3,), hand's rotation (3, 3), joints' axes (7, 3) and positions (7, 3) in the world."""
    rotation, position = jnp.eye(3), jnp.zeros(3)
    axes, places = [], []
    for joint, (offset, turns) in enumerate(LINK_FRAMES):
        position = position + rotation @ jnp.array(offset)
        rotation = rotation @ about(0, jnp.array(turns * math.pi / 2))
        axes.append(rotation[:, 2])
        places.append(position)
        rotation = rotation @ about(2, joints[joint])
    tip = position + rotation[:, 2] * (FLANGE + TCP_DISTANCE)
    return tip, rotation @ about(2, jnp.array(HAND_TURN)), jnp.stack(axes), jnp.stack(places)


def downward(yaw: jax.Array) -> jax.Array:
    """The hand's rotation (3, 3) when it points down at this yaw."""
    return about(2, yaw) @ jnp.diag(jnp.array([1.0, -1.0, -1.0]))


def pose(joints: jax.Array) -> jax.Array:
    """(x, y, z, yaw) of the gripper; (4,)."""
    tip, rotation, _, _ = forward(joints)
    return jnp.append(tip, jnp.arctan2(rotation[1, 0], rotation[0, 0]))


def approach(joints: jax.Array, target: jax.Array) -> jax.Array:
    """Joints (7,) after one damped least-squares step to a gripper pose (x, y, z, yaw); null space towards `HOME`."""
    tip, rotation, axes, places = forward(joints)
    wanted = downward(target[3])
    turn = 0.5 * jnp.sum(jnp.cross(rotation, wanted, axisa=0, axisb=0, axisc=0), axis=1)
    error = jnp.concatenate([target[:3] - tip, turn])
    jacobian = jnp.concatenate([jnp.cross(axes, tip[None] - places), axes], axis=1).T
    gram = jacobian @ jacobian.T + _DAMPING**2 * jnp.eye(6)
    home = _TO_HOME * (HOME - joints)
    change = home + jacobian.T @ jnp.linalg.solve(gram, error - jacobian @ home)
    return jnp.clip(joints + change, _LOW + _MARGIN, _HIGH - _MARGIN)
