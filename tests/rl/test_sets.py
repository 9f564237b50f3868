"""Networks of sets: neither the order of objects nor empty slots change what they say."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from brax.training.acme import running_statistics
from brax.training.acme.specs import Array as ArraySpec

from graphrl_jax.rl.config import PPOConfig
from graphrl_jax.rl.networks import init_params, make_networks
from graphrl_jax.rl.sets import POOLED, SetParams, pool

VECTOR, COUNT, FEATURES, ACTIONS = 3, 4, 5, 2
SIZE = VECTOR + COUNT * FEATURES
CONFIG = PPOConfig(policy="set", nodes=(COUNT, FEATURES), policy_hidden=(8,), value_hidden=(8, 8))


@pytest.fixture(scope="module")
def parameters():
    return init_params(jax.random.key(0), CONFIG, SIZE, ACTIONS)


def observations(nodes: np.ndarray) -> jax.Array:
    """Observations (B, O) with the same vector and these nodes (B, M, F)."""
    vector = np.tile(np.array([0.3, -0.2, 0.9], np.float32), (len(nodes), 1))
    return jnp.asarray(np.concatenate([vector, nodes.reshape(len(nodes), -1)], axis=1))


def nodes(*there: bool, seed: int = 1) -> np.ndarray:
    """Nodes (1, M, F) of which so many are there."""
    drawn = np.random.default_rng(seed).normal(size=(1, COUNT, FEATURES)).astype(np.float32)
    drawn[..., 0] = 1.0
    return drawn * np.array(there, np.float32)[None, :, None]


def outputs(parameters, found: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    network = make_networks(CONFIG, SIZE, ACTIONS)
    normalizer = running_statistics.init_state(ArraySpec((SIZE,), jnp.float32))
    seen = observations(found)
    logits = network.policy_network.apply(normalizer, parameters.policy, seen)
    return np.asarray(logits), np.asarray(network.value_network.apply(normalizer, parameters.value, seen))


def test_order_and_empty_slots_change_nothing(parameters):
    found = nodes(True, False, True, True)
    garbage = found.copy()
    garbage[:, 1, 1:] = 7.0
    for other in (found[:, [3, 1, 0, 2]], found[:, [1, 0, 2, 3]], garbage):
        for mine, theirs in zip(outputs(parameters, found), outputs(parameters, other), strict=True):
            np.testing.assert_allclose(mine, theirs, atol=1e-6)


def test_every_object_counts(parameters):
    found = nodes(True, True, True, True)
    _, value = outputs(parameters, found)
    for slot in range(COUNT):
        fewer = found.copy()
        fewer[:, slot] = 0.0
        assert np.abs(outputs(parameters, fewer)[1] - value).max() > 1e-4


def test_no_object_is_nothing_and_has_a_gradient(parameters):
    none = jnp.asarray(nodes(False, False, False, False))
    network: SetParams = parameters.value
    np.testing.assert_array_equal(pool(network, none), np.zeros((1, POOLED)))
    gradient = jax.grad(lambda params: pool(params, none).sum())(network)
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(gradient))


def test_a_fresh_policy_has_the_deviation_asked_for(parameters):
    logits, _ = outputs(parameters, nodes(True, True, False, True))
    normal = make_networks(CONFIG, SIZE, ACTIONS).parametric_action_distribution.create_dist(logits)
    np.testing.assert_allclose(normal.scale, CONFIG.initial_std, rtol=0.05)


def test_a_set_needs_its_numbers():
    with pytest.raises(ValueError, match=r"nodes is \(\) for policy 'set'; allowed: two numbers"):
        PPOConfig(policy="set")
    with pytest.raises(ValueError, match="policy is 'bag'; allowed: flat, set"):
        PPOConfig(policy="bag")
