"""Options of commands, one for every field of a config."""

from dataclasses import fields

import pytest

from graphrl_jax.cli.options import asked_for, field_help, overrides, refuse_existing
from graphrl_jax.cli.requests import Train
from graphrl_jax.pretrain.config import PretrainConfig, PretrainHyper
from graphrl_jax.rl.config import PPOConfig, PPOHyper


def test_only_what_was_given_is_asked_for():
    assert asked_for(Train().pretrain) == asked_for(Train().ppo) == {}
    options = overrides("Options", {PPOHyper: "", PPOConfig: "the preset's"}, left_out=("clip",))
    assert {field.name for field in fields(options)} == {
        field.name for kind in (PPOHyper, PPOConfig) for field in fields(kind)
    } - {"clip"}
    assert asked_for(options(discount=0.5, normalise_reward=False)) == {"discount": 0.5, "normalise_reward": False}


@pytest.mark.parametrize("kind", [PretrainConfig, PretrainHyper, PPOConfig, PPOHyper])
def test_every_field_has_its_line_of_help(kind):
    assert field_help(kind).keys() == {field.name for field in fields(kind)}
    assert all(field_help(kind).values())


def test_a_file_that_exists_is_not_overwritten(tmp_path):
    refuse_existing(tmp_path / "demos.npz")
    (tmp_path / "demos.npz").touch()
    with pytest.raises(ValueError, match="demos.npz exists already; choose another name"):
        refuse_existing(tmp_path / "demos.npz")
