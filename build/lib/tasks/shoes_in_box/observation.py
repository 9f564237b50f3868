"""The observation: (61,) float32, lengths in metres. Offsets are from the gripper along the world's axes, in which a
policy moves it. A grip's turn is the yaw at which the pads close on an object, against the gripper's; as sine and
cosine of twice the angle, because a half turn is the same grip.

0:5     gripper's x, y, z in the box's frame; sine and cosine of its yaw against the box's
5:7     openings of the fingers / 4 cm
7:14    the arm's joints, radians
14:18   the box's x, y in the world; sine and cosine of its yaw
18:20   angle of the lid / 2 rad, its rate
20:25   offset and grip's turn of the lid's bar
25:28   offset of the box's middle
28:54   per shoe: position in the box's frame, offset, sine and cosine of twice its yaw against the box's, its grip's
        turn, 1 (on its sole) to -1 (on its top), whether it is inside, whether a pad touches it
54:59   offset and grip's turn of what comes next: the bar until the lid is open, then the nearest shoe that is not
        inside, then the first shoe
59      whether the lid is open
60      commanded position of the fingers / 4 cm
"""

import jax
import jax.numpy as jnp

from tasks.shoes_in_box import geometry, kinematics
from tasks.shoes_in_box.model import FINGER_OPEN, LID_OPEN
from tasks.shoes_in_box.state import PhysicsState, lid_is_open, shoes, shoes_inside

SIZE = 61


def observe(state: PhysicsState) -> jax.Array:
    """The observation described in the module's docstring: (61,)."""
    frame = geometry.box_pose(state.box)
    here = kinematics.pose(state.qpos[:7])
    inside, opened, lying = shoes_inside(state), lid_is_open(state), shoes(state.qpos)
    yaw = here[3] - state.box[2]
    bar = jnp.concatenate(
        [geometry.bar(state.box, state.qpos[9]) - here[:3], _twice(state.box[2] + jnp.pi / 2 - here[3])]
    )
    places = (lying[:, :3] - frame.position[None]) @ frame.rotation
    yaws = jax.vmap(geometry.shoe_yaw)(lying)
    grips = jnp.concatenate([lying[:, :3] - here[None, :3], _twice(yaws - here[3])], axis=1)
    upright = jax.vmap(lambda shoe: geometry.shoe_pose(shoe).rotation[2, 2])(lying)
    flags = jnp.stack([upright, inside.astype(jnp.float32), state.touched.astype(jnp.float32)], axis=1)
    seen = jnp.concatenate([places, grips[:, :3], _twice(yaws - state.box[2]), grips[:, 3:], flags], axis=1)
    nearest = jnp.argmin(jnp.where(inside, 10.0, jnp.linalg.norm(grips[:, :3], axis=1)))
    return jnp.concatenate(
        [
            (here[:3] - frame.position) @ frame.rotation,
            jnp.stack([jnp.sin(yaw), jnp.cos(yaw)]),
            state.qpos[7:9] / FINGER_OPEN,
            state.qpos[:7],
            state.box[:2],
            jnp.stack([jnp.sin(state.box[2]), jnp.cos(state.box[2]), state.qpos[9] / LID_OPEN, state.qvel[9]]),
            bar,
            frame.position - here[:3],
            seen.ravel(),
            jnp.where(opened, grips[nearest], bar),
            jnp.stack([opened.astype(jnp.float32), state.finger / FINGER_OPEN]),
        ]
    )


def _twice(angle: jax.Array) -> jax.Array:
    """Sine and cosine of twice an angle (...): (..., 2)."""
    return jnp.stack([jnp.sin(2 * angle), jnp.cos(2 * angle)], axis=-1)
