"""`graphrl pretrain`: an encoder alone."""

import json

import pytest

from graphrl_jax import cli
from tests.helpers.commands import call, rejected

pytestmark = pytest.mark.usefixtures("outside_package")


def test_an_encoder_alone_is_trained_and_audited(demos_file, tmp_path):
    out = tmp_path / "encoder"
    call(cli.main, "pretrain", "--demos", demos_file, "--out", out, "--steps", 20)
    summary = json.loads((out / "summary.json").read_text())
    assert set(summary["trajectory_scores"]["by_kind"]) == {"success", "idle"}
    assert (out / "encoder.npz").exists() and (out / "figures" / "landscape.png").exists()
    assert summary["discrimination"]["failures"] == 2 and 0 <= summary["discrimination"]["auroc"] <= 1
    assert json.loads((out / "subtasks.json").read_text())["judged"] == summary["subtasks"]
    config = json.loads((out / "config.json").read_text())
    assert (config["command"], config["reward"], config["pretrain_config"]["steps"]) == ("pretrain", "graph", 20)


def test_a_reward_without_encoder_is_one_sentence(capsys, demos_file, tmp_path):
    out = tmp_path / "run"
    message = rejected(capsys, ["pretrain", "--demos", demos_file, "--out", out, "--reward", "env"], main=cli.main)
    assert "reward 'env' has no encoder to train" in message and not out.exists()
