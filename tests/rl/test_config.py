"""What PPO can be told."""

import pytest
from brax.training.networks import ACTIVATION

from graphrl_jax.rl.config import ACTIVATIONS, PPOConfig


@pytest.mark.parametrize(
    "field, value, message",
    [
        ("num_envs", 0, "num_envs is 0; allowed: 1 or more"),
        ("num_envs", 30, "num_envs is 30; allowed: a multiple of num_minibatches"),
        ("decision_steps", 0, "decision_steps is 0; allowed: 1 or more"),
        ("decision_steps", 7, r"episode_length is 120; allowed: a multiple of decision_steps \(7\)"),
        ("initial_std", 0.001, "initial_std is 0.001; allowed: above 0.001"),
        ("patience", -1, "patience is -1; allowed: 0 or more"),
        ("patience", 60, "patience is 60 without progress; allowed: 0"),
        ("retreat", 3, r"retreat is 3; allowed: 0, or up to patience \(0\) less 1"),
        ("retreat", -1, "retreat is -1; allowed: 0, or up to"),
        ("activation", "tanhh", "activation is 'tanhh'; allowed: .*tanh"),
    ],
)
def test_a_wrong_configuration_is_an_error_that_names_the_field(field, value, message):
    with pytest.raises(ValueError, match=message):
        PPOConfig(**{field: value})


def test_steps_are_those_of_control():
    sizes = PPOConfig(num_envs=8, unroll_length=3, num_minibatches=2, episode_length=10, decision_steps=5)
    assert sizes.steps_per_update == 8 * 3 * 5


def test_every_activation_is_one_of_braxs():
    assert set(ACTIVATIONS) <= set(ACTIVATION)
    assert all(PPOConfig(activation=name).activation == name for name in ACTIVATIONS)
