"""Perceptrons by hand."""

import jax
import numpy as np
import pytest

from graphrl_jax.encoder.layers import init_perceptron, init_weight, perceptron

APPLY = jax.jit(perceptron)


def test_a_relu_stands_between_layers_and_none_behind_the_last():
    first = {"weight": np.array([[1.0, -1.0]], np.float32), "bias": np.array([0.0, 1.0], np.float32)}
    second = {"weight": np.array([[1.0], [-2.0]], np.float32), "bias": np.array([0.5], np.float32)}
    inputs = np.array([[2.0], [-3.0]], np.float32)
    np.testing.assert_allclose(APPLY((first, second), inputs), [[2.5], [-7.5]])
    np.testing.assert_allclose(APPLY((first,), inputs), [[2.0, -1.0], [-3.0, 4.0]])


def test_leading_axes_are_examples():
    params = init_perceptron(jax.random.key(0), (3, 4, 2))
    inputs = np.random.default_rng(0).normal(size=(5, 3)).astype(np.float32)
    outputs = APPLY(params, inputs)
    assert outputs.shape == (5, 2)
    np.testing.assert_allclose(APPLY(params, inputs[1]), outputs[1], rtol=1e-5, atol=1e-6)


def test_weights_keep_the_size_of_signals_and_biases_are_zero():
    params = init_perceptron(jax.random.key(0), (400, 300, 200))
    assert [layer["weight"].shape for layer in params] == [(400, 300), (300, 200)]
    # A layer that a ReLU follows makes up for the half that the ReLU cuts off.
    assert float(params[0]["weight"].std()) == pytest.approx((2 / 400) ** 0.5, rel=0.02)
    assert float(params[1]["weight"].std()) == pytest.approx((1 / 300) ** 0.5, rel=0.02)
    assert all(not layer["bias"].any() for layer in params)
    assert float(init_weight(jax.random.key(1), 400, 300, gain=3.0).std()) == pytest.approx(3 / 20, rel=0.02)
