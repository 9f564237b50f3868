"""What a detector would report in place of perfect boxes: objects hidden by others, missed, or boxed inexactly.

A model, not a renderer: an object is hidden where the boxes of nearer objects cover its own, so a slanted lid hides a
little more than it would. What is hidden too far, or missed, is a masked slot of the graph.
"""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np

_POINTS = np.stack(np.meshgrid(*[np.linspace(-0.5, 0.5, 7)] * 2), axis=-1).reshape(-1, 2)


@dataclass(frozen=True)
class Detector:
    """A perfect detector unless told otherwise (static).

    Attributes:
      jitter: deviation of a box's centre, in its sides, and of the logarithm of its sides, drawn anew every frame.
      dropout: probability that an object is missed in a frame.
      visible: share of an object's box that must not be covered by nearer ones for it to be seen; 0 sees through all.

    Raises:
      ValueError: a value out of its range; the message names it.
    """

    jitter: float = 0.0
    dropout: float = 0.0
    visible: float = 0.0

    def __post_init__(self) -> None:
        for field, high in (("jitter", 1.0), ("dropout", 1.0), ("visible", 1.0)):
            if not 0.0 <= getattr(self, field) <= high:
                raise ValueError(f"Detector.{field} is {getattr(self, field)}; allowed: 0 to {high:g}")

    def see(
        self, key: jax.Array, boxes: jax.Array, depths: jax.Array, hides: np.ndarray
    ) -> tuple[jax.Array, jax.Array]:
        """One frame.

        Args:
          key: randomness of this frame.
          boxes: (N, 4) perfect boxes.
          depths: (N,) distances of the objects from the camera.
          hides: (N,) bool, which objects hide what is behind them; an open box does not hide what is in it.

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
    """Share of each box (N, 4) that no nearer box covers, over a grid of points: (N,) float32."""
    points = boxes[:, None, :2] + _POINTS * boxes[:, None, 2:]
    offsets = jnp.abs(points[:, :, None] - boxes[:, :2])
    inside = (offsets <= boxes[:, 2:] / 2).all(-1)
    nearer = (depths[None, :] < depths[:, None]) & hides
    return 1.0 - (inside & nearer[:, None, :]).any(-1).mean(1)
