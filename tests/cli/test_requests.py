"""What commands can be asked, and that it reaches config.json."""

import json
import subprocess
import sys
from dataclasses import asdict, fields
from typing import Any

import pytest

from graphrl_jax import cli
from graphrl_jax.cli import COMMANDS
from graphrl_jax.cli import train as train_command
from graphrl_jax.experiment import experiment
from graphrl_jax.pretrain.config import PretrainConfig, PretrainHyper
from graphrl_jax.rl.config import PPOConfig, PPOHyper
from tasks.shoes_in_box.task import ShoesInBox
from tests.helpers.commands import TRAIN

pytestmark = pytest.mark.usefixtures("outside_package")


class Begun(Exception):
    """Raised where a run would start to compute."""


@pytest.fixture
def configured(monkeypatch, tmp_path):
    """Config.json of a `graphrl train` that stops before it computes."""

    def stop(*_: object) -> None:
        raise Begun

    def configured(*arguments: str, train: list[str] = TRAIN) -> dict:
        with pytest.raises(Begun):
            cli.train_main([*train, *arguments, "--out", str(tmp_path / "run")])
        return json.loads((tmp_path / "run" / "config.json").read_text())

    monkeypatch.setattr(experiment, "run", stop)
    assert train_command.experiment is experiment
    return configured


PRETRAIN_FLOATS = {field.name: 0.375 for field in fields(PretrainHyper)}
PRETRAIN_SIZES = {"steps": 7, "batch_size": 3, "num_frames": 5, "decode_from": "pooled", "tcc_loss": "classification"}
PPO_FLOATS = {field.name: 0.375 for field in fields(PPOHyper)}
PPO_SIZES = {
    "num_envs": 12, "unroll_length": 3, "num_epochs": 5, "num_minibatches": 6, "episode_length": 9,
    "decision_steps": 3, "policy": "flat", "initial_std": 0.5, "progress": True, "patience": 7, "retreat": 0,
    "policy_hidden": [5, 6], "value_hidden": [7], "activation": "swish", "normalise_reward": False,
    "stagger_episodes": False,
}  # fmt: skip


def options(group: str, values: dict) -> list[str]:
    """As they are typed."""
    arguments = []
    for name, value in values.items():
        listed = value if isinstance(value, list) else [value]
        arguments += [f"--{group}.{name.replace('_', '-')}", *map(str, listed)]
    return arguments


def test_every_field_can_be_asked_for_and_reaches_config_json(configured):
    pretrain, ppo = PRETRAIN_FLOATS | PRETRAIN_SIZES, PPO_FLOATS | PPO_SIZES
    config = configured(*options("pretrain", pretrain), *options("ppo", ppo))
    assert config["pretrain"] == PRETRAIN_FLOATS
    assert PRETRAIN_SIZES.items() <= config["pretrain_config"].items()
    assert (config["ppo"], config["ppo_config"]) == (PPO_FLOATS, PPO_SIZES | {"nodes": []})
    known = {field.name for kind in (PretrainHyper, PretrainConfig) for field in fields(kind)}
    assert known - pretrain.keys() == {"encoder", "activity"}  # the method's
    assert {field.name for kind in (PPOHyper, PPOConfig) for field in fields(kind)} == {*ppo, "nodes"}


def test_what_is_not_asked_for_is_written_down_too(configured):
    config = configured()
    assert config["pretrain"] == asdict(PretrainHyper())
    assert (config["ppo_config"]["num_envs"], config["ppo"]["decay_updates"]) == (64, 4.0)
    assert (config["task"], config["reward"], config["preset"], config["version"]) == ("carry", "graph", "smoke", 2)
    assert config["engine"] is None


def test_the_engine_that_is_asked_for_is_written_down_and_used_again(configured, monkeypatch, tmp_path):
    engines = []

    def stop(members: object, task: Any, *_: object) -> None:
        engines.append(task.engine.name)
        raise Begun

    monkeypatch.setattr(experiment, "run", stop)
    config = configured("--engine", "mjx", train=["--task", "match_regions", "--preset", "smoke"])
    assert config["engine"] == "mjx"
    with pytest.raises(Begun):
        cli.train_main(["--resume", "--out", str(tmp_path / "run")])
    assert engines == ["mjx", "mjx"]


def test_a_task_sets_sizes_of_its_own(configured):
    train = ["--task", "shoes_in_box", "--preset", "cpu", "--reward", "env"]
    config = configured("--updates", "3", "--ppo.num-envs", "16", train=train)
    assert (config["updates"], config["ppo_config"]["num_envs"]) == (3, 16)
    size = ShoesInBox.training_sizes["cpu"].ppo
    own = (config["ppo_config"]["progress"], config["ppo"]["entropy_cost"])
    assert own == (size["progress"], size["entropy_cost"])


@pytest.mark.parametrize(
    "short, group, field, value",
    [
        (["--alpha", "4"], "pretrain", "alpha", 4.0),
        (["--encoder-steps", "11"], "pretrain_config", "steps", 11),
        (["--tcc", "regression_huber"], "pretrain_config", "tcc_loss", "regression_huber"),
    ],
)
def test_short_names_are_those_of_fields(configured, short, group, field, value):
    assert configured(*short)[group][field] == value


@pytest.mark.parametrize("command", COMMANDS)
def test_help_names_every_option_and_starts_without_jax(command):
    program = f"""
import sys
from graphrl_jax import cli
try:
    cli.main(["{command}", "--help"])
finally:
    print("jax" in sys.modules, "brax" in sys.modules)
"""
    printed = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout
    assert printed.endswith("False False\n")
    request, _ = COMMANDS[command]
    for field in fields(request):
        assert field.name.replace("_", "-") in printed.replace("_", "-").lower(), field.name
