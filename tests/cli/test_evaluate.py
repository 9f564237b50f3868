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


def test_an_engine_for_a_task_of_one_engine_is_one_sentence(capsys, finished):
    message = rejected(capsys, ["evaluate", finished, "--engine", "mjx"], main=cli.main)
    assert "task 'carry' has one engine of its own; leave the engine 'mjx' out" in message


def test_no_episodes_are_one_sentence(capsys, tmp_path):
    assert "--episodes is 0" in rejected(capsys, ["evaluate", tmp_path, "--episodes", 0], main=cli.main)
