"""`graphrl demos`."""

import json
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from graphrl_jax import cli
from graphrl_jax.demonstrations import load
from graphrl_jax.experiment.experiment import make_demonstrations
from graphrl_jax.experiment.settings import compose
from graphrl_jax.registry import make_task
from tests.helpers.commands import call, rejected

pytestmark = pytest.mark.usefixtures("outside_package")


def test_a_command_prints_nothing_but_its_line(tmp_path):
    """In a process of its own: what libraries print while they are imported counts too."""
    command = [sys.executable, "-m", "graphrl_jax", "demos", "--task", "carry", "--out", tmp_path / "demos.npz"]
    printed = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert json.loads(printed)["demonstrations"] == 64


def test_successes_and_failures_are_written(demos_file):
    demos = load(demos_file)
    assert (len(demos), int(demos.success.sum()), demos.task) == (8, 6, "carry")


def test_the_same_seed_gives_the_demonstrations_of_a_run(demos_file):
    task = make_task("carry")
    settings = replace(compose(task, preset="smoke", seed=0), demonstrations=6)
    run, written = make_demonstrations(task, settings), load(demos_file)
    count = len(run)
    np.testing.assert_array_equal(written.boxes[:count, : run.num_frames], run.boxes)
    np.testing.assert_array_equal(written.success[:count], run.success)


def test_images_are_kept_on_request(tmp_path):
    file = tmp_path / "demos.npz"
    call(cli.main, "demos", "--task", "carry", "--num", 2, "--images", 8, "--out", file)
    assert load(file).images(8).shape == (2, 30, 8, 8, 3)


def test_demonstrations_are_not_overwritten(capsys, demos_file):
    before = demos_file.read_bytes()
    message = rejected(capsys, ["demos", "--task", "carry", "--out", demos_file], main=cli.main)
    assert str(demos_file) in message and demos_file.read_bytes() == before


@pytest.mark.parametrize(
    "task, engine, message",
    [
        ("match_regions", "bullet", "unknown engine 'bullet'; known engines: mjx, mujoco, warp"),
        ("carry", "mjx", "task 'carry' has one engine of its own; leave the engine 'mjx' out"),
    ],
)
def test_an_engine_that_there_is_not_is_one_sentence(capsys, tmp_path, task, engine, message):
    arguments = ["demos", "--task", task, "--engine", engine, "--out", tmp_path / "demos.npz"]
    assert message in rejected(capsys, arguments, main=cli.main) and not list(tmp_path.iterdir())


@pytest.mark.parametrize("option, least", [("num", 1), ("failures", 0), ("images", 1)])
def test_too_few_are_one_sentence(capsys, tmp_path, option, least):
    arguments = ["demos", "--task", "carry", f"--{option}", least - 1, "--out", tmp_path / "demos.npz"]
    assert f"--{option} is {least - 1}; allowed: {least} or more" in rejected(capsys, arguments, main=cli.main)
    assert not list(tmp_path.iterdir())
