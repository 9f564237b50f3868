"""Whole runs on a task that lives in a package outside the repository: what they leave, and that they go on."""

import json
import shutil
import signal
import subprocess
import sys
from dataclasses import replace

import jax
import numpy as np
import pytest

from graphrl_jax import cli
from graphrl_jax.demonstrations import DemonstrationError
from graphrl_jax.experiment import experiment
from graphrl_jax.experiment.settings import compose
from graphrl_jax.registry import make_task
from tests.helpers.commands import TRAIN, arrays, call, contents, finished_run, numbers

pytestmark = pytest.mark.usefixtures("outside_package")

# Dies without a word as soon as the file named first has been written.
DIES_AFTER = """
import os, signal, sys
from graphrl_jax import cli
from graphrl_jax.experiment import train_policy
from graphrl_jax.reward import model
def dying(save):
    def save_and_die(path, tree):
        save(path, tree)
        if path.name == sys.argv[1]:
            os.kill(os.getpid(), signal.SIGKILL)
    return save_and_die
model.save_tensors = dying(model.save_tensors)
train_policy.save_generation = dying(train_policy.save_generation)
cli.train_main(sys.argv[2:])
"""


@pytest.fixture(scope="module")
def finished(outside_package, tmp_path_factory):
    """A run that was never interrupted."""
    return finished_run(tmp_path_factory.getbasetemp())


def test_a_run_directory_holds_everything(finished):
    files = {str(path.relative_to(finished)) for path in finished.rglob("*") if path.is_file()}
    assert files == {
        "config.json", "metrics.jsonl", "summary.json", "demonstrations.npz", "model.safetensors", "README.md",
        "encoder.json", "subtasks.json", "policy.npz", "train_state.npz", "train_state.previous.npz", "rollout.mp4",
        "figures/learning_curve.png", "figures/landscape.png", "figures/reward_on_demonstrations.png",
        "figures/reward_on_rollouts.png",
    }  # fmt: skip
    summary = json.loads((finished / "summary.json").read_text())
    for name in ("success_rate", "mean_score", "mean_return", "env_steps", "wall_s", "compile_s", "train_steps_per_s"):
        assert np.isfinite(summary[name]), name
    for name in ("kendall_tau", "pair_accuracy", "finished_above_unfinished", "maxima_inside"):
        assert np.isfinite(summary["encoder"][name]), name
    assert {"jax", "brax", "mujoco-mjx", "python"} <= summary["versions"].keys()
    assert summary["env_steps"] == 4 * 64 * 8
    records = [json.loads(line) for line in (finished / "metrics.jsonl").read_text().splitlines()]
    policy_records = [record for record in records if record["stage"] == "ppo"]
    assert [record["update"] for record in policy_records] == [2, 4]
    assert {"env_reward", "learned_reward", "distance", "success"} <= policy_records[0].keys()


@pytest.mark.parametrize("file", ["model.safetensors", "train_state.npz"])
def test_a_killed_run_resumes_to_the_same_numbers(finished, tmp_path, file):
    out = tmp_path / "killed"
    killed = subprocess.run([sys.executable, "-c", DIES_AFTER, file, *TRAIN, "--out", out], stderr=subprocess.PIPE)
    assert killed.returncode == -signal.SIGKILL, killed.stderr
    assert not (out / "summary.json").exists()
    call(cli.train_main, "--out", out, "--resume")
    assert numbers(out) == numbers(finished)
    expected, found = arrays(finished / "train_state.npz"), arrays(out / "train_state.npz")
    assert expected.keys() == found.keys()
    for name, array in expected.items():
        np.testing.assert_array_equal(found[name], array, err_msg=name)


def test_a_finished_run_is_left_as_it_is(finished, tmp_path):
    """Also where it is without what only training needs, as the released runs are."""
    out = tmp_path / "finished"
    shutil.copytree(finished, out)
    for name in ("encoder.json", "demonstrations.npz", "train_state.npz"):
        (out / name).unlink()
    before = contents(out)
    answer = call(cli.train_main, "--out", out, "--resume")
    assert contents(out) == before
    assert answer["success_rate"] == json.loads((out / "summary.json").read_text())["success_rate"]


def test_demonstrations_that_went_astray_are_made_again(finished, tmp_path):
    out = tmp_path / "astray"
    shutil.copytree(finished, out)
    for name in ("summary.json", "demonstrations.npz"):
        (out / name).unlink()
    call(cli.train_main, "--out", out, "--resume")
    assert numbers(out) == numbers(finished)
    expected, found = arrays(finished / "demonstrations.npz"), arrays(out / "demonstrations.npz")
    for name, array in expected.items():
        np.testing.assert_array_equal(found[name], array, err_msg=name)


def test_episodes_that_are_no_whole_decisions_are_refused_at_once():
    task = make_task("carry")
    experiment.refuse_impossible(task, compose(task, preset="smoke", ppo={"decision_steps": 6}))
    settings = compose(task, preset="smoke", ppo={"decision_steps": 7, "episode_length": 14})
    with pytest.raises(ValueError, match="decision_steps is 7; allowed: divisors of the 30 steps of carry's episodes"):
        experiment.refuse_impossible(task, settings)


@pytest.mark.parametrize("field", ["names", "is_articulated"])
def test_demonstrations_of_other_objects_are_refused_by_the_field_that_differs(tmp_path, field):
    task = make_task("carry")
    values = {"names": ("region", "robot", "brick"), "is_articulated": (False, False, True)}[field]
    demos = task.demonstrate(jax.random.key(0), 2)
    replace(demos, objects=replace(demos.objects, **{field: values})).save(tmp_path / "demos.npz")
    expected = getattr(task.objects, field)
    with pytest.raises(DemonstrationError) as refused:
        experiment.load_demonstrations(tmp_path / "demos.npz", task.objects, task.frame_rate, task.name)
    assert f"demos.npz: {field} is {values}, but task carry has {expected}" in str(refused.value)


def test_environments_that_devices_cannot_share_are_refused_at_once(monkeypatch):
    task = make_task("carry")
    settings = compose(task, preset="smoke")
    experiment.refuse_impossible(task, settings)
    devices = 3 * jax.devices()
    monkeypatch.setattr(jax, "devices", lambda: devices)
    with pytest.raises(ValueError, match="num_envs is 64; allowed on 3 devices: multiples of 3"):
        experiment.refuse_impossible(task, settings)
    experiment.refuse_impossible(task, settings, members=3)
