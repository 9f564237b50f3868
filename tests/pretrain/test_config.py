"""What pretraining can be told: what is not allowed is named."""

import pytest

from graphrl_jax.pretrain.config import PretrainConfig


@pytest.mark.parametrize(
    ("field", "value", "says"),
    [
        ("steps", 0, "steps is 0; allowed: 1 or more"),
        ("batch_size", 1, "batch_size is 1; allowed: 2 or more"),
        ("num_frames", 1, "num_frames is 1; allowed: 2 or more"),
        ("decode_from", "nodes", "decode_from is 'nodes'; allowed: node, pooled"),
        ("tcc_loss", "mse", "tcc_loss is 'mse'; allowed: regression_mse, .*classification"),
    ],
)
def test_a_wrong_configuration_names_the_field(field, value, says):
    with pytest.raises(ValueError, match=f"PretrainConfig.{says}"):
        PretrainConfig(**{field: value})
