"""XIRL's encoder (Zakka et al. 2021), a baseline: a picture instead of a graph, a convolutional network, TCC alone.

XIRL's is a ResNet-18 pretrained on ImageNet; here weights start at random, and sizes are a setting. With two residual
blocks per stage and widths 64 to 512 (`RESNET_18`) it is much like that. Normalisation is over a position's channels,
so that one picture's embedding does not depend on others, and the last feature map is not averaged over positions: it
is they that the reward is about.
"""

from dataclasses import dataclass

import jax
import jax.numpy as jnp

from graphrl_jax import layers


@dataclass(frozen=True)
class PixelConfig:
    """Sizes of the network (all static).

    | field  | meaning                                                                       |
    |--------|-------------------------------------------------------------------------------|
    | size   | pixels along a picture's edge                                                 |
    | patch  | edge of the patches that the first layer cuts it into                         |
    | widths | channels after each stage; the first keeps the resolution, the others halve it |
    | blocks | residual blocks per stage                                                     |

    Raises:
      ValueError: a field is too small, or the stages do not divide the picture; the message names it.
    """

    size: int = 64
    patch: int = 4
    widths: tuple[int, ...] = (32, 32, 64)
    blocks: int = 0

    def __post_init__(self) -> None:
        for field, least in (("size", 1), ("patch", 1), ("blocks", 0)):
            if getattr(self, field) < least:
                raise ValueError(f"PixelConfig.{field} must be at least {least}, got {getattr(self, field)}")
        if not self.widths or min(self.widths) < 1:
            raise ValueError(f"PixelConfig.widths must be positive, at least one, got {self.widths}")
        step = self.patch * 2 ** (len(self.widths) - 1)
        if self.size % step:
            raise ValueError(f"PixelConfig.size must be a multiple of {step}, got {self.size}")

    @property
    def positions(self) -> int:
        """Along an edge of the last feature map."""
        return self.size // (self.patch * 2 ** (len(self.widths) - 1))


RESNET_18 = PixelConfig(widths=(64, 128, 256, 512), blocks=2, patch=2)
"""For a GPU."""


def init(key: jax.Array, config: PixelConfig, embedding: int) -> dict:
    """Random parameters; embeddings of size `embedding` (D)."""
    keys = iter(jax.random.split(key, 2 + len(config.widths) * (1 + 2 * config.blocks)))
    channels, side = 3, config.patch
    stages = []
    for width in config.widths:
        inner = [(_convolution(next(keys), 3, width, width), _convolution(next(keys), 3, width, width))
                 for _ in range(config.blocks)]  # fmt: skip
        stages.append({"in": _convolution(next(keys), side, channels, width), "blocks": tuple(inner)})
        channels, side = width, 3
    features = config.positions**2 * channels
    return {"stages": tuple(stages), "output": layers.init_perceptron(next(keys), (features, embedding))}


def _convolution(key: jax.Array, side: int, inputs: int, outputs: int) -> layers.Linear:
    weight = layers.init_weight(key, side * side * inputs, outputs, gain=2.0**0.5)
    return {"weight": weight.reshape(side, side, inputs, outputs), "bias": jnp.zeros((outputs,), jnp.float32)}


def encode(params: dict, picture: jax.Array) -> jax.Array:
    """phi of one picture (H, W, 3), float32 in [0, 1] or uint8: (D,) float32."""
    if picture.dtype == jnp.uint8:
        picture = picture.astype(jnp.float32) / 255
    features = 2 * picture - 1
    for number, stage in enumerate(params["stages"]):
        # The first stage cuts the picture into patches, the others halve the resolution.
        stride = stage["in"]["weight"].shape[0] if number == 0 else 2
        features = jax.nn.relu(_convolve(stage["in"], features, stride))
        for first, second in stage["blocks"]:
            inner = jax.nn.relu(_convolve(first, _normalise(features), 1))
            features = features + _convolve(second, _normalise(inner), 1)
    return layers.perceptron(params["output"], features.reshape(-1))


def _convolve(params: layers.Linear, features: jax.Array, stride: int) -> jax.Array:
    """(H, W, inputs) -> (H / stride, W / stride, outputs), zeros around: a matrix product over shifted pictures.

    XLA's own convolution takes 16 times as long inside a loop on a CPU, where training and rollouts are.
    """
    side, _, inputs, outputs = params["weight"].shape
    height, width = features.shape[0] // stride, features.shape[1] // stride
    spare = side - stride
    padded = jnp.pad(features, ((spare // 2, spare - spare // 2),) * 2 + ((0, 0),))
    shifted = [
        padded[y : y + stride * height : stride, x : x + stride * width : stride]
        for y in range(side)
        for x in range(side)
    ]
    patches = jnp.concatenate(shifted, axis=-1)
    return patches @ params["weight"].reshape(side * side * inputs, outputs) + params["bias"]


def _normalise(features: jax.Array) -> jax.Array:
    """Zero mean and unit variance over each position's channels."""
    return jax.nn.standardize(features, axis=-1, epsilon=1e-5)
