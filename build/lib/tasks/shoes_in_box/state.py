"""The physics state of Shoes in Box, and quantities computed from it."""

from typing import NamedTuple

import jax
import jax.numpy as jnp

from tasks.shoes_in_box import geometry

LID_COUNTS_AS_OPEN = 1.85
"""Radians, near the lid's stop."""
EVENT_NAMES = ("lid_open", "shoe_1_placed", "shoe_2_placed")


class PhysicsState(NamedTuple):
    """State kept between steps; the rest of the simulation follows from it.

    | field     | shape  | dtype   | meaning                                                                    |
    |-----------|--------|---------|----------------------------------------------------------------------------|
    | qpos      | (24,)  | float32 | arm (7), left and right finger, lid, then position and quaternion per shoe |
    | qvel      | (22,)  | float32 | their rates                                                                |
    | warmstart | (22,)  | float32 | accelerations the solver starts from                                       |
    | target    | (4,)   | float32 | target of the gripper: x, y, z, yaw                                        |
    | arm       | (7,)   | float32 | joint targets of the arm, which follow `target`                            |
    | finger    | ()     | float32 | commanded position of each finger                                          |
    | box       | (3,)   | float32 | x, y, yaw of the box                                                       |
    | touched   | (2,)   | bool    | a pad touches the shoe                                                     |
    | frame     | ()     | uint32  | seed of the detector noise in this frame; it grows by one per frame        |
    """

    qpos: jax.Array
    qvel: jax.Array
    warmstart: jax.Array
    target: jax.Array
    arm: jax.Array
    finger: jax.Array
    box: jax.Array
    touched: jax.Array
    frame: jax.Array


def shoes(qpos: jax.Array) -> jax.Array:
    """Free joints (2, 7) of both shoes in `qpos` (24,)."""
    return qpos[10:].reshape(2, 7)


def lid_is_open(state: PhysicsState) -> jax.Array:
    """Whether the lid is open, near its stop: () bool."""
    return state.qpos[9] > LID_COUNTS_AS_OPEN


def shoes_inside(state: PhysicsState) -> jax.Array:
    """Whether each shoe's centre is inside the box: (2,) bool."""
    return jax.vmap(lambda shoe: geometry.inside_box(state.box, shoe[:3]))(shoes(state.qpos))


def success(state: PhysicsState) -> jax.Array:
    """Whether both shoes are inside and no pad touches them: () bool."""
    return shoes_inside(state).all() & ~state.touched.any()


def score(state: PhysicsState) -> jax.Array:
    """A third for the open lid and for each shoe inside; ()."""
    return (lid_is_open(state) + shoes_inside(state).sum()) / 3


def events(state: PhysicsState) -> jax.Array:
    """Whether each of `EVENT_NAMES` is reached; a shoe counts once it is let go: (3,) bool."""
    return jnp.append(lid_is_open(state), shoes_inside(state) & ~state.touched)
