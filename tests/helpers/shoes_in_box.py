"""Shoes in Box for tests: one task object, so that programs compiled for it serve them all, scenes and starts."""

import jax
import jax.numpy as jnp
import numpy as np

from tasks.shoes_in_box import kinematics, layouts
from tasks.shoes_in_box.starts import Starts
from tasks.shoes_in_box.state import PhysicsState
from tasks.shoes_in_box.task import ShoesInBox

TASK = ShoesInBox()
"""The task with the device's engine."""
BOX = jnp.asarray(layouts.BOX_START)


def scene(start: PhysicsState, places: tuple, lid: float = 0.0) -> PhysicsState:
    """A start with the arm at home, both shoes at (x, y, yaw), and the lid at an angle."""
    qpos = layouts.pack(jnp.asarray(kinematics.HOME), jnp.asarray(lid), jnp.array(places))
    return start._replace(qpos=qpos, box=BOX)


def repeated(state: PhysicsState, *shape: int) -> PhysicsState:
    """The same state many times, with further axes in front."""
    return jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (*shape, *leaf.shape)), state)


def numbered_starts(start: PhysicsState, ends: np.ndarray, frames: int) -> Starts:
    """A made-up table: state t of episode d has the frame number 1000 d + t and the lid at (1000 d + t) / 10^4;
    slot n is active from frame 5 n + 1 on."""
    number = 1000 * np.arange(len(ends))[:, None] + np.arange(frames)
    states = repeated(start, len(ends), frames)
    states = states._replace(qpos=states.qpos.at[..., 9].set(number / 1e4), frame=jnp.asarray(number, jnp.uint32))
    active = np.stack([number % 1000 > 5 * slot for slot in range(5)], axis=-1)
    return Starts(states, jnp.asarray(active), jnp.asarray(ends))
