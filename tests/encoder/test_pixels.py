"""XIRL's network against loops over pixels."""

import jax
import numpy as np

from graphrl_jax.encoder import pixels
from graphrl_jax.encoder.config import RESNET_18, PixelConfig

CONFIG = PixelConfig(size=8, patch=2, widths=(3, 4), blocks=1)
PARAMS = pixels.init(jax.random.key(0), CONFIG, 5)
ENCODE = jax.jit(pixels.encode)
IMAGE = np.random.default_rng(0).uniform(size=(8, 8, 3)).astype(np.float32)


def convolved(layer: dict, features: np.ndarray, stride: int, before: int) -> np.ndarray:
    """A convolution by loops; `before` rows and columns of zeros lie above and to the left."""
    weight, bias = (np.asarray(layer[name]) for name in ("weight", "bias"))
    side, length = weight.shape[0], len(features)
    padded = np.pad(features, ((before, side), (before, side), (0, 0)))
    places = range(0, length, stride)
    rows = [[np.einsum("ijc,ijco->o", padded[y : y + side, x : x + side], weight) + bias for x in places]
            for y in places]  # fmt: skip
    return np.array(rows)


def test_the_network_is_residual_convolutions():
    features = 2 * IMAGE - 1
    for number, level in enumerate(PARAMS.levels):
        # A 3 x 3 kernel of stride 2 over an even length has its padding at the end.
        features = np.maximum(convolved(level["in"], features, 2, 0), 0)
        assert features.shape[0] == (4, 2)[number]
        for first, second in level["blocks"]:
            inner = np.maximum(convolved(first, standardised(features), 1, 1), 0)
            features = features + convolved(second, standardised(inner), 1, 1)
    output = PARAMS.output[0]
    expected = features.ravel() @ np.asarray(output["weight"]) + np.asarray(output["bias"])
    np.testing.assert_allclose(ENCODE(PARAMS, IMAGE), expected, rtol=1e-3, atol=1e-3)


def standardised(features: np.ndarray) -> np.ndarray:
    return (features - features.mean(-1, keepdims=True)) / np.sqrt(features.var(-1, keepdims=True) + 1e-5)


def test_bytes_are_seen_as_their_share_of_255():
    as_bytes = np.round(255 * IMAGE).astype(np.uint8)
    np.testing.assert_allclose(ENCODE(PARAMS, as_bytes), ENCODE(PARAMS, as_bytes.astype(np.float32) / 255), atol=1e-5)


def test_the_resnet_has_as_many_convolutions_as_resnet_18():
    params = jax.eval_shape(lambda key: pixels.init(key, RESNET_18, 32), jax.random.key(0))
    assert sum(leaf.ndim == 4 for leaf in jax.tree.leaves(params)) == 20  # as ResNet-18's, three shortcuts included
    assert 11e6 < sum(leaf.size for leaf in jax.tree.leaves(params)) < 15e6  # ResNet-18 has 11.2 M
