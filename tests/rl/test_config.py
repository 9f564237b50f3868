"""What PPO can be told."""

import pytest
from brax.training.networks import ACTIVATION

from graphrl_jax.rl.config import ACTIVATIONS, PPOConfig


@pytest.mark.parametrize(
    "field, value, message",
    [
        ("num_envs", 0, "num_envs is 0; allowed: 1 or more"),
        ("num_envs", 30, "num_envs is 30; allowed: a multiple of num_minibatches"),
        ("activation", "tanhh", "activation is 'tanhh'; allowed: .*tanh"),
    ],
)
def test_a_wrong_configuration_is_an_error_that_names_the_field(field, value, message):
    with pytest.raises(ValueError, match=message):
        PPOConfig(**{field: value})


def test_every_activation_is_one_of_braxs():
    assert set(ACTIVATIONS) <= set(ACTIVATION)
    assert all(PPOConfig(activation=name).activation == name for name in ACTIVATIONS)
