"""Options of commands, one for every field of a config."""

from dataclasses import fields
from pathlib import Path

import pytest

from graphrl_jax import cli
from graphrl_jax.cli.options import asked_for, field_help, overrides, refuse_existing, refuse_other, refuse_seeds
from graphrl_jax.cli.requests import Demos, Sweep, Train
from graphrl_jax.experiment.run_directory import Run
from graphrl_jax.experiment.settings import compose
from graphrl_jax.pretrain.config import PretrainConfig, PretrainHyper
from graphrl_jax.registry import make_task
from graphrl_jax.rl.config import PPOConfig, PPOHyper
from tests.helpers.commands import rejected


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


@pytest.mark.parametrize("seed", [-1, 2**32, 2**63])
@pytest.mark.parametrize(
    "command, option",
    [("train", "seed"), ("demos", "seed"), ("pretrain", "seed"), ("evaluate", "seed"), ("sweep", "first-seed")],
)
def test_a_seed_out_of_range_is_one_sentence_and_leaves_nothing(capsys, tmp_path, command, option, seed):
    arguments = {"pretrain": ["--demos", tmp_path / "demos.npz"], "evaluate": [tmp_path]}.get(command, [])
    arguments = [command, *arguments, f"--{option}", seed, "--out", tmp_path / "out"]
    assert f"--{option} is {seed}; allowed: 0 to 4294967295" in rejected(capsys, arguments, main=cli.main)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "arguments, message",
    [
        (["train", "--resume", "--ablate", "edges"], "--ablate changes nothing with --resume, which goes on with"),
        (["train", "--reward", "env", "--demos", "d.npz"], "--demos changes nothing with --reward env"),
        (["train", "--process", 1], "--process changes nothing without --processes above 1"),
        (["sweep", "--reward", "env", "--encoders-only"], "--encoders-only changes nothing with --reward env"),
        (["sweep", "--encoders-only", "--updates", 3], "--updates changes nothing with --encoders-only"),
        (["sweep", "--encoders-only", "--ppo.discount", 0.5], "--ppo.discount changes nothing with --encoders-only"),
        (["sweep", "--encoders-only", "--sweep", "ppo.clip=0.1,0.2"], "--sweep ppo.clip changes nothing"),
        (["evaluate", "run", "--video-episodes", 0], "--out changes nothing with --video-episodes 0"),
    ],
)
def test_options_that_change_nothing_are_refused(capsys, tmp_path, arguments, message):
    assert message in rejected(capsys, [*arguments, "--out", tmp_path / "out"], main=cli.main)
    assert not list(tmp_path.iterdir())


def test_a_resumed_run_is_not_asked_for_other_settings(capsys, outside_package, tmp_path):
    task = make_task("carry")
    Run.start(tmp_path / "run", compose(task, preset="smoke", ppo={"clip": 0.1}))
    for option, value, kept in (("--updates", 9, 4), ("--ppo.clip", 0.2, 0.1), ("--task", "shoes_in_box", "carry")):
        arguments = ["train", "--resume", option, value, "--out", tmp_path / "run"]
        message = f"{option} is {value}, but {tmp_path}/run goes on with its own settings, {kept}; leave it out"
        assert message in rejected(capsys, arguments, main=cli.main)
    request = Train(task="carry", updates=4, seed=0, out=tmp_path / "run", resume=True)
    refuse_other(request, {"task": "carry", "updates": 4, "seed": 0}, tmp_path)
    sweep = Sweep(tmp_path, alphas="1,2", seeds=2, resume=True)
    with pytest.raises(ValueError, match="--seeds is 2, but .* goes on with its own settings, 3; leave it out"):
        refuse_other(sweep, {"alphas": "1,2", "seeds": 3, "ppo": {}}, tmp_path)


def test_all_seeds_of_a_sweep_are_in_range():
    refuse_seeds(Sweep(Path("out"), first_seed=2**32 - 2, seeds=2))
    refuse_seeds(Demos(Path("out"), seed=2**32 - 1))
    with pytest.raises(ValueError, match="--first-seed is 4294967294 and the last seed 4294967296; allowed: 0 to"):
        refuse_seeds(Sweep(Path("out"), first_seed=2**32 - 2, seeds=3))
