"""XIRL's encoder (Zakka et al. 2021), a baseline: a convolutional network on images, trained by TCC alone.

XIRL uses a ResNet-18 pretrained on ImageNet. Here weights start at random, and sizes are configurable; `RESNET_18` (two
residual blocks per level, widths 64 to 512) is close to it. Normalisation is over the channels of each position, so
that the embedding of an image does not depend on other images. The last feature map is not averaged over positions,
because the reward depends on positions.
"""

from dataclasses import dataclass

import jax
import jax.numpy as jnp

from graphrl_jax.encoder import layers
from graphrl_jax.encoder.config import PixelConfig

Level = dict


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class PixelParams:
    """Parameters, all float32.

    | field  | meaning                                                                                        |
    |--------|------------------------------------------------------------------------------------------------|
    | output | perceptron, last feature map to D                                                              |
    | levels | per resolution the convolution that produces it (`in`), and pairs of convolutions in `blocks`  |
    """

    output: layers.Perceptron
    levels: tuple[Level, ...]


def init(key: jax.Array, config: PixelConfig, embedding: int) -> PixelParams:
    """Random parameters for embeddings of size `embedding` (D)."""
    keys = iter(jax.random.split(key, 2 + len(config.widths) * (1 + 2 * config.blocks)))
    channels, side = 3, config.patch
    levels = []
    for width in config.widths:
        inner = [(_convolution(next(keys), 3, width, width), _convolution(next(keys), 3, width, width))
                 for _ in range(config.blocks)]  # fmt: skip
        levels.append({"in": _convolution(next(keys), side, channels, width), "blocks": tuple(inner)})
        channels, side = width, 3
    features = config.positions**2 * channels
    return PixelParams(layers.init_perceptron(next(keys), (features, embedding)), tuple(levels))


def _convolution(key: jax.Array, side: int, inputs: int, outputs: int) -> layers.Linear:
    weight = layers.init_weight(key, side * side * inputs, outputs, gain=2.0**0.5)
    return {"weight": weight.reshape(side, side, inputs, outputs), "bias": jnp.zeros((outputs,), jnp.float32)}


def encode(params: PixelParams, image: jax.Array) -> jax.Array:
    """phi of one image (H, W, 3), float32 in [0, 1] or uint8: (D,) float32."""
    if image.dtype == jnp.uint8:
        image = image.astype(jnp.float32) / 255
    features = 2 * image - 1
    for number, level in enumerate(params.levels):
        # The first level cuts the image into patches, the others halve the resolution.
        stride = level["in"]["weight"].shape[0] if number == 0 else 2
        features = jax.nn.relu(_convolve(level["in"], features, stride))
        for first, second in level["blocks"]:
            inner = jax.nn.relu(_convolve(first, _normalise(features), 1))
            features = features + _convolve(second, _normalise(inner), 1)
    return layers.perceptron(params.output, features.reshape(-1))


def _convolve(params: layers.Linear, features: jax.Array, stride: int) -> jax.Array:
    """Zero-padded convolution (H, W, inputs) -> (H / stride, W / stride, outputs): a matrix product of shifted images.

    XLA's own convolution takes 16 times as long inside a loop on CPU, and training and rollouts are loops.
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
    return layers.add_bias(patches @ params["weight"].reshape(side * side * inputs, outputs), params["bias"])


def _normalise(features: jax.Array) -> jax.Array:
    """Normalises the channels of each position to zero mean and unit variance."""
    return jax.nn.standardize(features, axis=-1, epsilon=1e-5)
