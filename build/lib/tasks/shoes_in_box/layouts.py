"""Distribution of starts: the box on the table, turned as in RLBench, a shoe on either side, the arm above."""

import math
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np

from tasks.shoes_in_box.kinematics import HOME
from tasks.shoes_in_box.model import FINGER_OPEN, SOLE

BOX_START = np.array([0.47, 0.0, 0.0], np.float32)
SHOE_STARTS = np.array([[0.40, 0.33, 0.0], [0.40, -0.33, 0.0]], np.float32)


@dataclass(frozen=True)
class Layout:
    """Distribution of starts: poses deviate uniformly by at most these metres and radians.

    Attributes:
      box, box_yaw: deviation of the box.
      shoe, shoe_yaw: deviation of each shoe.
    """

    box: float = 0.02
    box_yaw: float = math.pi / 8
    shoe: float = 0.03
    shoe_yaw: float = math.pi / 8

    def sample(self, key: jax.Array) -> tuple[jax.Array, jax.Array]:
        """A start: qpos (24,) as in `state.PhysicsState`, and the box's (x, y, yaw)."""
        box_key, shoe_key = jax.random.split(key)
        spread = jnp.array([self.box, self.box, self.box_yaw])
        box = BOX_START + spread * jax.random.uniform(box_key, (3,), minval=-1.0)
        spread = jnp.array([self.shoe, self.shoe, self.shoe_yaw])
        shoes = SHOE_STARTS + spread[None] * jax.random.uniform(shoe_key, (2, 3), minval=-1.0)
        return pack(jnp.asarray(HOME), jnp.zeros(()), shoes), box


def pack(arm: jax.Array, lid: jax.Array, shoes: jax.Array) -> jax.Array:
    """Joins joints (7,), the lid's angle and shoes (2, 3) at (x, y, yaw) to a qpos (24,) with the gripper open."""
    half = shoes[:, 2:] / 2
    zero = jnp.zeros((2, 1))
    flat = jnp.concatenate([shoes[:, :2], zero + SOLE[2], jnp.cos(half), zero, zero, jnp.sin(half)], axis=-1)
    return jnp.concatenate([arm, jnp.full((2,), FINGER_OPEN), lid[None], flat.ravel()])
