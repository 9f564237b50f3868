"""The environmental reward, shaped towards the next object to move."""

import jax
import jax.numpy as jnp

from tasks.shoes_in_box import geometry, kinematics
from tasks.shoes_in_box.model import LID_OPEN
from tasks.shoes_in_box.state import PhysicsState, lid_is_open, score, shoes, shoes_inside


def environment_reward(state: PhysicsState) -> jax.Array:
    """Score plus the lid's angle, minus distances of shoes from the box and of the gripper from the next object; ()."""
    here = kinematics.pose(state.qpos[:7])[:3]
    inside, opened = shoes_inside(state), lid_is_open(state)
    places = shoes(state.qpos)[:, :3]
    to_box = jnp.where(inside, 0.0, jnp.linalg.norm(places[:, :2] - state.box[None, :2], axis=-1))
    to_shoe = jnp.min(jnp.where(inside, 1.0, jnp.linalg.norm(places - here[None], axis=-1)))
    to_bar = jnp.linalg.norm(geometry.bar(state.box, state.qpos[9]) - here)
    reach = jnp.where(opened, jnp.where(inside.all(), 0.0, to_shoe), 1.0 + to_bar)
    return score(state) + state.qpos[9] / LID_OPEN - to_box.sum() - 0.5 * reach - 1.0
