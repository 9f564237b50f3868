"""Appearance of MAGICAL's objects in its frames, and MAGICAL's 18 discrete actions."""

import jax
import jax.numpy as jnp

from graphrl_jax.perception.colour_detector import ColourDetector, Look

NUM_ACTIONS = 18

_GREEN, _GREEN_LINE = (195, 208, 130), (183, 198, 105)
_YELLOW, _YELLOW_LINE = (254, 213, 123), (254, 201, 86)
_BLUE, _BLUE_LINE = (135, 185, 211), (110, 170, 202)
_REGION = (224, 231, 191)
# Body, its outline, eyes, fingers; the wall around the arena has the colour of the fingers.
_ROBOT = ((162, 163, 175), (144, 145, 159), (26, 26, 26), (231, 231, 234))
_WALL = 0.013
_STAR, _SQUARE, _PENTAGON, _CIRCLE = 1.46, 1.25, 1.14, 1.0

LOOKS = (
    Look(0, (_REGION,)),
    Look(1, _ROBOT),
    Look(2, (_GREEN,), (_GREEN_LINE,), reach=_STAR),
    Look(3, (_GREEN,), (_GREEN_LINE,), reach=_SQUARE),
    Look(4, (_BLUE,), (_BLUE_LINE,), reach=_PENTAGON),
    Look(5, (_YELLOW,), (_YELLOW_LINE,), reach=_CIRCLE),
    Look(6, (_YELLOW,), (_YELLOW_LINE,), reach=_PENTAGON),
)
"""Looks by class id of `objects.OBJECTS`."""


def action(number: jax.Array) -> jax.Array:
    """Speed, turn and gripper of one of MAGICAL's actions: (3,).

    Args:
      number: () int, 0 to 17: number % 3 is nothing, forwards, backwards; (number % 9) // 3 is nothing, left, right;
        from 9 on the gripper closes.
    """
    drive, steer = jnp.array([0.0, 1.0, -1.0]), jnp.array([0.0, 1.0, -1.0])
    return jnp.stack([drive[number % 3], steer[number % 9 // 3], jnp.where(number < 9, 1.0, -1.0)])


def detector() -> ColourDetector:
    """Detector of Match Regions' objects in MAGICAL's frames from above, of any size."""
    return ColourDetector(LOOKS, margin=_WALL)
