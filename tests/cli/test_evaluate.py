"""`graphrl evaluate`."""

import shutil

import pytest

from graphrl_jax import cli
from tests.helpers.commands import call, rejected

pytestmark = pytest.mark.usefixtures("outside_package")


def test_evaluate_prints_one_json_line_and_writes_a_video(finished, tmp_path):
    run = tmp_path / "run"
    shutil.copytree(finished, run)
    arguments = ["evaluate", run, "--episodes", 16, "--seed", 3]
    first, second = call(cli.main, *arguments), call(cli.main, *arguments, "--video-episodes", 0)
    assert first == second
    assert first.keys() == {"success_rate", "mean_score", "episodes", "mean_return", "seed"}
    assert (first["episodes"], first["seed"]) == (16, 3)
    assert (run / "evaluation_3.mp4").stat().st_size > 1000


def test_evaluating_what_is_no_run_is_one_sentence(capsys, tmp_path):
    assert "config.json" in rejected(capsys, ["evaluate", tmp_path], main=cli.main)


def test_a_task_is_looked_at_before_any_training(finished, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    arguments = ["evaluate", "carry", "--episodes", 16, "--seed", 3]
    found = {policy: call(cli.main, *arguments, "--policy", policy) for policy in ("zero", "expert")}
    assert found["zero"].keys() == {"success_rate", "mean_score", "episodes", "mean_return", "seed"}
    assert [(one["success_rate"], one["episodes"]) for one in found.values()] == [(0.0, 16), (1.0, 16)]
    assert {path.name for path in tmp_path.iterdir()} == {"carry_zero_3.mp4", "carry_expert_3.mp4"}
    learned = call(cli.main, *arguments, "--policy", "expert", "--reward-model", finished, "--out", tmp_path / "a.mp4")
    assert learned["success_rate"] == 1.0 and learned["mean_return"] != found["expert"]["mean_return"]
    assert (tmp_path / "a.mp4").stat().st_size > 1000


def test_a_policy_decides_whether_a_task_or_a_folder_is_meant(capsys, finished, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    short = ["--episodes", 2, "--seed", 3, "--video-episodes", 0]
    message = rejected(capsys, ["evaluate", "carry", *short], main=cli.main)
    assert "carry is a task and no run's folder; --policy says what acts: zero, random, expert" in message
    shutil.copytree(finished, tmp_path / "carry")
    assert call(cli.main, "evaluate", "carry", *short) == call(cli.main, "evaluate", finished, *short)
    assert call(cli.main, "evaluate", "carry", "--policy", "expert", *short)["success_rate"] == 1.0
    message = rejected(capsys, ["evaluate", finished, "--policy", "zero", *short], main=cli.main)
    assert f"--policy zero needs the name of a task, not {finished}; known tasks: carry" in message
    message = rejected(capsys, ["evaluate", "carry", "--policy", "best", *short], main=cli.main)
    assert "unknown policy 'best'; known policies: zero, random, expert" in message
    message = rejected(capsys, ["evaluate", finished, "--reward-model", finished, *short], main=cli.main)
    assert "--reward-model changes nothing without --policy" in message


def test_an_engine_for_a_task_of_one_engine_is_one_sentence(capsys, finished):
    message = rejected(capsys, ["evaluate", finished, "--engine", "mjx"], main=cli.main)
    assert "task 'carry' has one engine of its own; leave the engine 'mjx' out" in message


def test_no_episodes_are_one_sentence(capsys, tmp_path):
    assert "--episodes is 0" in rejected(capsys, ["evaluate", tmp_path, "--episodes", 0], main=cli.main)
