"""Networks before anything is learned."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from brax.training.acme import running_statistics
from brax.training.acme.specs import Array as ArraySpec

from graphrl_jax.rl.config import PPOConfig
from graphrl_jax.rl.networks import init_params, make_inference, make_networks


@pytest.mark.parametrize("initial_std", [0.3, 1.0])
def test_a_fresh_policy_starts_near_mean_0_with_the_deviation_asked_for(initial_std):
    config = PPOConfig(policy_hidden=(8, 8), value_hidden=(8,), initial_std=initial_std)
    normalizer = running_statistics.init_state(ArraySpec((3,), jnp.float32))
    params = init_params(jax.random.key(0), config, 3, 2)
    observations = np.linspace(-2, 2, 15, dtype=np.float32).reshape(5, 3)
    network = make_networks(config, 3, 2)
    logits = network.policy_network.apply(normalizer, params.policy, observations)
    normal = network.parametric_action_distribution.create_dist(logits)
    assert np.abs(normal.loc).max() < 0.05
    np.testing.assert_allclose(normal.scale, initial_std, rtol=0.05)
    act = make_inference(config, 3, 2)
    np.testing.assert_allclose(
        act((normalizer, params.policy), observations, jax.random.key(1)), np.tanh(normal.loc), atol=1e-6
    )
