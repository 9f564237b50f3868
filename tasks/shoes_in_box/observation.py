"""The observation: (46,) float32, lengths in metres. Positions and offsets are in the box's frame unless noted.

0:5     gripper's x, y, z; sine and cosine of its yaw against the box's
5:7     openings of the fingers / 4 cm
7:14    the arm's joints, radians
14:18   the box's x, y in the world; sine and cosine of its yaw
18:20   angle of the lid / 2 rad, its rate
20:23   offset of the lid's bar from the gripper
23:45   per shoe: position, offset from the gripper, sine and cosine of twice its yaw against the box's, 1 (on its sole)
        to -1 (on its top), whether it is inside, whether a pad touches it
45      whether the lid is open
"""

import jax
import jax.numpy as jnp

from tasks.shoes_in_box import geometry, kinematics
from tasks.shoes_in_box.model import FINGER_OPEN, LID_OPEN
from tasks.shoes_in_box.state import PhysicsState, lid_is_open, shoes, shoes_inside

SIZE = 46


def observe(state: PhysicsState) -> jax.Array:
    """The observation described in the module's docstring: (46,)."""
    frame = geometry.box_pose(state.box)
    here = kinematics.pose(state.qpos[:7])

    def there(point: jax.Array) -> jax.Array:
        return (point - frame.position) @ frame.rotation

    def seen(shoe: jax.Array, inside: jax.Array, touched: jax.Array) -> jax.Array:
        twice = 2 * (geometry.shoe_yaw(shoe) - state.box[2])
        lying = geometry.shoe_pose(shoe).rotation[2, 2]
        flags = jnp.stack([jnp.sin(twice), jnp.cos(twice), lying, inside, touched])
        return jnp.concatenate([there(shoe[:3]), frame.rotation.T @ (shoe[:3] - here[:3]), flags])

    yaw = here[3] - state.box[2]
    bar = geometry.bar(state.box, state.qpos[9])
    return jnp.concatenate(
        [
            there(here[:3]),
            jnp.stack([jnp.sin(yaw), jnp.cos(yaw)]),
            state.qpos[7:9] / FINGER_OPEN,
            state.qpos[:7],
            state.box[:2],
            jnp.stack([jnp.sin(state.box[2]), jnp.cos(state.box[2]), state.qpos[9] / LID_OPEN, state.qvel[9]]),
            frame.rotation.T @ (bar - here[:3]),
            jax.vmap(seen)(shoes(state.qpos), shoes_inside(state).astype(float), state.touched.astype(float)).ravel(),
            lid_is_open(state).astype(jnp.float32)[None],
        ]
    )
