"""Adam against the textbook, clipping, the schedule."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from graphrl_jax.optimizer import adam_init, adam_update, clip_by_global_norm, global_norm, warmup_cosine

UPDATE = jax.jit(adam_update)
CLIP = jax.jit(clip_by_global_norm)
COSINE = jax.jit(warmup_cosine)


def test_first_step_by_hand():
    # Both moments are corrected back to the gradient itself, so the step is learning_rate * sign(gradient).
    params = {"a": np.array([1.0, -2.0], np.float32)}
    grads = {"a": np.array([0.5, -4.0], np.float32)}
    params, state = UPDATE(grads, jax.jit(adam_init)(params), params, 0.1)
    np.testing.assert_allclose(params["a"], [0.9, -1.9], rtol=1e-5)
    np.testing.assert_allclose(state.mu["a"], [0.05, -0.4], rtol=1e-5)
    np.testing.assert_allclose(state.nu["a"], [0.00025, 0.016], rtol=1e-5)
    assert int(state.step) == 1 and state.step.dtype == jnp.int32


def test_ten_steps_equal_the_textbook():
    random = np.random.default_rng(0)
    params = {"a": random.normal(size=3).astype(np.float32), "b": random.normal(size=(2, 2)).astype(np.float32)}
    learning_rate, b1, b2, eps, weight_decay = 0.03, 0.8, 0.95, 1e-3, 0.1
    expected = {name: value.astype(np.float64) for name, value in params.items()}
    m = {name: np.zeros_like(value) for name, value in expected.items()}
    v = {name: np.zeros_like(value) for name, value in expected.items()}
    state = jax.jit(adam_init)(params)
    for step in range(1, 11):
        grads = {name: random.normal(size=value.shape).astype(np.float32) for name, value in params.items()}
        params, state = UPDATE(grads, state, params, learning_rate, b1, b2, eps, weight_decay)
        for name, gradient in grads.items():
            m[name] = b1 * m[name] + (1 - b1) * gradient
            v[name] = b2 * v[name] + (1 - b2) * gradient**2
            direction = m[name] / (1 - b1**step) / (np.sqrt(v[name] / (1 - b2**step)) + eps)
            expected[name] -= learning_rate * (direction + weight_decay * expected[name])
    for name in params:
        np.testing.assert_allclose(params[name], expected[name], rtol=2e-5, atol=1e-6)


def test_a_zero_gradient_leaves_the_parameters():
    params = {"a": np.ones(2, np.float32)}
    new, _ = UPDATE({"a": np.zeros(2, np.float32)}, jax.jit(adam_init)(params), params, 0.1)
    np.testing.assert_array_equal(new["a"], params["a"])


def test_state_keeps_its_types_so_that_a_scan_can_carry_it():
    params = {"a": jnp.asarray(np.ones(2, np.float32))}
    state = jax.eval_shape(adam_init, params)
    after = jax.eval_shape(lambda p, s: adam_update(p, s, p, 0.1), params, state)
    before = jax.tree.map(lambda leaf: (leaf.shape, leaf.dtype, leaf.weak_type), (params, state))
    assert jax.tree.map(lambda leaf: (leaf.shape, leaf.dtype, leaf.weak_type), after) == before


def test_clipping_by_hand():
    grads = {"a": np.array([3.0], np.float32), "b": np.array([[4.0]], np.float32)}
    clipped, norm = CLIP(grads, 1.0)
    assert float(norm) == pytest.approx(5.0)
    np.testing.assert_allclose(clipped["a"], [0.6], rtol=1e-6)
    np.testing.assert_allclose(clipped["b"], [[0.8]], rtol=1e-6)


@settings(max_examples=20, deadline=None)
# Compiled programs take subnormal numbers for zero.
@given(st.lists(st.floats(-1e3, 1e3, width=32, allow_subnormal=False), min_size=4, max_size=4), st.floats(0.01, 100.0))
def test_clipping_bounds_the_norm_and_leaves_short_gradients(values, max_norm):
    grads = {"a": np.array(values, np.float32)}
    clipped, norm = CLIP(grads, max_norm)
    size = np.linalg.norm(np.asarray(clipped["a"]))
    assert size <= max_norm * 1.0001
    if np.linalg.norm(values) < max_norm:
        np.testing.assert_array_equal(clipped["a"], grads["a"])
    np.testing.assert_allclose(norm, np.linalg.norm(values), rtol=1e-5, atol=1e-30)


def test_global_norm_of_zeros_is_zero():
    assert float(jax.jit(global_norm)({"a": np.zeros(3, np.float32)})) == 0.0


def test_the_schedule_meets_its_corners():
    def value(step):
        return float(COSINE(step, 100, 0.4, 20, 0.1))

    assert value(0) == 0.0
    assert value(10) == pytest.approx(0.2)
    assert value(20) == pytest.approx(0.4)
    assert value(60) == pytest.approx(0.25)
    assert value(100) == pytest.approx(0.1)
    assert value(1000) == pytest.approx(0.1)


def test_the_schedule_is_a_cosine_between_its_corners():
    assert float(COSINE(40, 100, 0.4, 20, 0.1)) == pytest.approx(0.1 + 0.3 * 0.5 * (1 + np.cos(np.pi / 4)))


def test_without_warm_up_the_schedule_starts_at_its_peak():
    assert float(COSINE(0, 100, 0.4, 0, 0.0)) == pytest.approx(0.4)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_gradient_that_is_not_finite_changes_nothing(bad):
    params = {"a": jnp.ones(2), "b": jnp.zeros(3)}
    _, state = adam_update({"a": jnp.ones(2), "b": jnp.ones(3)}, adam_init(params), params, 0.1)
    grads = {"a": jnp.ones(2), "b": jnp.array([0.0, bad, 0.0])}
    after = adam_update(grads, state, params, 0.1, weight_decay=0.1)
    jax.tree.map(np.testing.assert_array_equal, after, (params, state))
