"""Linear layers and perceptrons as pure functions on plain pytrees. Inputs may have any leading axes."""

from collections.abc import Sequence

import jax
import jax.numpy as jnp

Linear = dict[str, jax.Array]
Perceptron = tuple[Linear, ...]


def init_weight(key: jax.Array, inputs: int, outputs: int, gain: float = 1.0) -> jax.Array:
    """Normal weights with variance gain^2 / inputs: (inputs, outputs) float32."""
    return jax.random.normal(key, (inputs, outputs), jnp.float32) * (gain / inputs**0.5)


def init_perceptron(key: jax.Array, sizes: Sequence[int]) -> Perceptron:
    """Weights (He et al. 2015) and zero biases of a perceptron with layer sizes `sizes`, inputs first."""
    keys = jax.random.split(key, len(sizes) - 1)
    last = len(sizes) - 2
    return tuple(
        {
            # Layers followed by a ReLU get gain sqrt(2): a ReLU halves the second moment.
            "weight": init_weight(layer_key, inputs, outputs, gain=2.0**0.5 if index < last else 1.0),
            "bias": jnp.zeros((outputs,), jnp.float32),
        }
        for index, (layer_key, inputs, outputs) in enumerate(zip(keys, sizes[:-1], sizes[1:], strict=True))
    )


def perceptron(params: Perceptron, inputs: jax.Array) -> jax.Array:
    """(..., inputs) -> (..., outputs), with a ReLU between layers and none after the last."""
    for layer in params[:-1]:
        inputs = jax.nn.relu(linear(layer, inputs))
    return linear(params[-1], inputs)


def linear(params: Linear, inputs: jax.Array) -> jax.Array:
    """(..., inputs) -> (..., outputs)."""
    return add_bias(inputs @ params["weight"], params["bias"])


def add_bias(values: jax.Array, bias: jax.Array) -> jax.Array:
    """(..., H) plus (H,)."""
    return values + jnp.broadcast_to(bias, values.shape)
