"""Detector noise: objects that are hidden by others, missed, or have inexact boxes.

Occlusion is a model without rendering: an object is hidden where boxes of nearer objects cover its box, so a slanted
lid hides a little more than in an image. The slot of an object that is hidden too far, or missed, is masked.
"""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np

_POINTS = np.stack(np.meshgrid(*[np.linspace(-0.5, 0.5, 7)] * 2), axis=-1).reshape(-1, 2)


@dataclass(frozen=True)
class DetectorNoise:
    """Settings of the detector noise (static); the defaults are a perfect detector.

    Attributes:
      jitter: standard deviation of a box's centre, in its sides, and of the logarithm of its sides, drawn every frame.
      dropout: probability that an object is missed in a frame.
      visible: least share of an object's box that nearer boxes leave uncovered if it is detected; 0: no occlusion.

    Raises:
      ValueError: a value out of its range; the message names it.
    """

    jitter: float = 0.0
    dropout: float = 0.0
    visible: float = 0.0

    def __post_init__(self) -> None:
        for field, high in (("jitter", 1.0), ("dropout", 1.0), ("visible", 1.0)):
            if not 0.0 <= getattr(self, field) <= high:
                raise ValueError(f"DetectorNoise.{field} is {getattr(self, field)}; allowed: 0 to {high:g}")

    def see(
        self, key: jax.Array, boxes: jax.Array, depths: jax.Array, hides: np.ndarray
    ) -> tuple[jax.Array, jax.Array]:
        """Detected boxes and mask of one frame.

        Args:
          key: randomness of this frame.
          boxes: (N, 4) perfect boxes.
          depths: (N,) distances of the objects from the camera.
          hides: (N,) bool, objects that hide what is behind them; an open box does not hide what is in it.

        Returns:
          Boxes (N, 4) float32 and mask (N,) bool.
        """
        mask = jnp.ones(boxes.shape[0], bool)
        if self.visible:
            mask &= visible_share(boxes, depths, hides) >= self.visible
        jitter_key, dropout_key = jax.random.split(key)
        if self.dropout:
            mask &= ~jax.random.bernoulli(dropout_key, self.dropout, mask.shape)
        if self.jitter:
            noise = self.jitter * jax.random.normal(jitter_key, boxes.shape)
            centres, sizes = boxes[:, :2], boxes[:, 2:]
            boxes = jnp.concatenate([centres + noise[:, :2] * sizes, sizes * jnp.exp(noise[:, 2:])], axis=1)
        return boxes, mask


def visible_share(boxes: jax.Array, depths: jax.Array, hides: np.ndarray) -> jax.Array:
    """Share of each box (N, 4) that no nearer box covers, estimated on a grid of points: (N,) float32."""
    points = boxes[:, None, :2] + _POINTS[None] * boxes[:, None, 2:]
    offsets = jnp.abs(points[:, :, None] - boxes[None, None, :, :2])
    inside = (offsets <= boxes[None, None, :, 2:] / 2).all(-1)
    nearer = (depths[None, :] < depths[:, None]) & hides[None]
    return 1.0 - (inside & nearer[:, None, :]).any(-1).mean(1)
