"""The command that repeats a run leads to the run's settings."""

import shlex
from pathlib import Path

import pytest

from graphrl_jax import cli
from graphrl_jax.cli import pretrain as pretrain_command
from graphrl_jax.cli import train as train_command
from graphrl_jax.cli.repeat import repeating
from graphrl_jax.experiment.run_directory import Run
from graphrl_jax.experiment.settings import Settings, compose
from graphrl_jax.registry import make_task

pytestmark = pytest.mark.usefixtures("outside_package")


class Begun(Exception):
    """Raised where a run would start to compute."""


@pytest.fixture
def begun(monkeypatch):
    """Runs of commands stop before they compute."""

    def stop(*_: object) -> None:
        raise Begun

    monkeypatch.setattr(train_command.experiment, "run", stop)
    monkeypatch.setattr(pretrain_command, "train_encoders", stop)


def settings_of(command: str, folder: Path) -> Settings:
    """What a command that is typed in, with another folder, leads to."""
    words = shlex.split(command.replace("\\\n", ""))
    with pytest.raises(Begun):
        cli.main([*words[1:-1], str(folder)])
    return Run(folder).settings("train", "pretrain")


@pytest.mark.parametrize(
    "given",
    [
        {},
        {"reward": "graphirl", "seed": 3, "ablations": ["persistence"]},
        {"ablations": ["edges", "displacement"], "pretrain": {"alpha": 3.25, "steps": 7, "rearranged": 0.0}},
        {"updates": 9, "ppo": {"learning_rate": 1 / 3000, "policy_hidden": (8, 8), "progress": True, "num_envs": 32}},
        {"reward": "env", "preset": "cpu", "pretrain": {"tau": 0.3}},
    ],
)
def test_a_training_is_repeated(begun, tmp_path, given):
    settings = compose(make_task("carry"), **{"preset": "smoke"} | given)
    command, note = repeating(settings, "train", "runs/again")
    assert note == "" and "--out runs/again" in command
    assert settings_of(command, tmp_path / "again") == settings


def test_a_pretraining_is_repeated(begun, tmp_path, demos_file):
    settings = compose(make_task("carry"), demos=str(demos_file), ablations=["edges"], pretrain={"steps": 5})
    command, note = repeating(settings, "pretrain", "again")
    assert note == "" and command == (
        f"graphrl pretrain \\\n  --demos {demos_file} \\\n  --reward graph \\\n  --seed 0 \\\n  --ablate edges \\\n"
        "  --pretrain.steps 5 \\\n  --out again"
    )
    assert settings_of(command, tmp_path / "again") == settings


def test_what_no_command_gives_is_told(tmp_path):
    older = Run("checkpoints/match_regions_env").settings()
    command, note = repeating(older, "train", "again")
    assert "--reward env" in command and "because this release has other defaults than the one that made it" in note
    unknown = compose(make_task("carry"), demos=str(tmp_path / "gone.npz"))
    assert "gone.npz: there is no such file" in repeating(unknown, "pretrain", "again")[1]
