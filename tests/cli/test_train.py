"""`graphrl train`: what it refuses in one sentence, and that every learned reward trains like any other."""

import json
import shutil
import subprocess
import sys

import jax
import numpy as np
import pytest
from tensorboardX import event_file_writer

from graphrl_jax import cli
from graphrl_jax.experiment import sharding
from graphrl_jax.experiment.methods import ABLATIONS
from graphrl_jax.experiment.run_directory import Run
from graphrl_jax.experiment.settings import compose
from graphrl_jax.registry import make_task
from tests.helpers.commands import TRAIN, arrays, call, contents, rejected
from tests.helpers.events import logged, numbers

LEFT_OUT = [name for name in ABLATIONS if name != "displacement"]
"""All that can be left out at once: one ablation at most sets the rule of activity."""
pytestmark = pytest.mark.usefixtures("outside_package")


def test_in_a_process_of_its_own_a_wrong_request_is_one_sentence_too():
    command = [sys.executable, "-m", "graphrl_jax", "train", "--reward", "money"]
    answer = subprocess.run(command, capture_output=True, text=True)
    assert (answer.returncode, answer.stdout) == (2, "")
    assert answer.stderr.startswith("error: unknown reward 'money'") and answer.stderr.count("\n") == 1


@pytest.mark.parametrize(
    "arguments, names",
    [
        (["--task", "juggling"], ["'juggling'", "match_regions"]),
        (["--reward", "money"], ["'money'", "graph_with_robot"]),
        (["--preset", "huge"], ["'huge'", "smoke"]),
        (["--updates", "0"], ["updates is 0", "1 or more"]),
        (["--demos", "nowhere.npz"], ["nowhere.npz"]),
        (["--resume"], ["--out"]),
        (["--ablate", "colour"], ["'colour'", "persistence"]),
        (["--reward", "env", "--alpha", "2"], ["pretrain.alpha", "reward env"]),
        (["--tcc", "cubic"], ["tcc_loss is 'cubic'", "regression_mse"]),
        (["--ppo.num-envs", "5"], ["num_envs is 5", "num_minibatches"]),
        (["--ppo.decision-steps", "7"], ["episode_length is 120", "a multiple of decision_steps (7)"]),
        (
            [*TRAIN, "--ppo.decision-steps", "7", "--ppo.episode-length", "14"],
            ["decision_steps is 7", "divisors of the 30 steps of carry's episodes"],
        ),
        (["--track", "paper"], ["unknown tracker 'paper'", "tensorboard, wandb, trackio"]),
        (["--engine", "bullet"], ["unknown engine 'bullet'", "mjx, mujoco, warp"]),
        ([*TRAIN, "--engine", "mjx"], ["task 'carry' has one engine of its own", "leave the engine 'mjx' out"]),
        (["--coordinator", "localhost:1", "--processes", "2"], ["--out"]),
        (["--processes", "2", "--out", "run"], ["--coordinator"]),
    ],
)
def test_a_wrong_request_is_one_sentence(capsys, monkeypatch, tmp_path, arguments, names):
    monkeypatch.chdir(tmp_path)
    message = rejected(capsys, arguments)
    assert all(name in message for name in names), message
    assert not list(tmp_path.iterdir())


def test_mujoco_on_several_devices_is_one_sentence(capsys, monkeypatch, tmp_path):
    monkeypatch.setattr(jax, "device_count", lambda: 8)
    out = tmp_path / "run"
    message = rejected(capsys, ["--task", "match_regions", "--engine", "mujoco", "--out", out])
    assert "engine 'mujoco' runs on one CPU device, but this process has 8 devices of kind cpu" in message
    assert not out.exists()


@pytest.mark.parametrize("damage", ["truncated", "version", "nan"])
def test_a_wrong_demonstration_file_is_one_sentence(capsys, tmp_path, demos_file, damage):
    file, out = tmp_path / "demos.npz", tmp_path / "run"
    if damage == "truncated":
        file.write_bytes(demos_file.read_bytes()[:-200])
        field = "demos.npz"
    else:
        field, value = {"version": ("version", np.int32(99)), "nan": ("boxes", np.nan)}[damage]
        fields = arrays(demos_file)
        fields[field] = np.full_like(fields[field], value)
        np.savez(file, **fields)
    assert field in rejected(capsys, ["--demos", file, "--out", out])
    assert not out.exists()


def test_demonstrations_of_another_task_are_refused(capsys, tmp_path, demos_file):
    message = rejected(capsys, ["--task", "match_regions", "--demos", demos_file, "--out", tmp_path / "run"])
    assert str(demos_file) in message and "'block'" in message and not (tmp_path / "run").exists()


def test_a_folder_that_holds_another_run_is_left_alone(capsys, tmp_path):
    run = Run.start(tmp_path / "run", compose(make_task("carry"), preset="smoke"))
    run.log({"stage": "ppo", "update": 2})
    before = contents(run.path)
    assert str(run.path) in rejected(capsys, [*TRAIN, "--out", run.path])
    assert contents(run.path) == before


def test_a_run_of_an_older_release_is_refused_with_one_sentence(capsys, tmp_path):
    (tmp_path / "config.json").write_text(json.dumps({"command": "train", "version": 1, "seed": 0}))
    message = rejected(capsys, ["--out", tmp_path, "--resume"])
    assert "version 1" in message and "version 2" in message


@pytest.mark.parametrize(
    "arguments",
    [["--reward", "graphirl"], ["--reward", "xirl"], ["--ablate", *LEFT_OUT, "--tcc", "classification"]],
)
def test_each_trains_is_evaluated_and_resumed_like_any_other(tmp_path, arguments):
    out = tmp_path / "run"
    call(cli.train_main, *TRAIN, *arguments, "--out", out)
    config = json.loads((out / "config.json").read_text())
    assert config["reward"] == (arguments[1] if arguments[0] == "--reward" else "graph")
    # As many as at the end of the training: that program serves again.
    outcome = call(cli.main, "evaluate", out, "--episodes", "16", "--video-episodes", "0")
    assert outcome["episodes"] == 16
    again = call(cli.train_main, "--out", out, "--resume")
    assert again["episodes"] == json.loads((out / "summary.json").read_text())["episodes"]
    found = call(cli.main, "stages", out, "--demos", out / "demonstrations.npz")
    assert found["demonstrations"] == 10


@pytest.mark.parametrize(
    "arguments, message",
    [
        (["--task", "shoes_in_box"], "task shoes_in_box draws no images inside a program"),
        (["--task", "carry", "--ablate", "edges"], "ablation 'edges' changes nothing about reward 'xirl'"),
    ],
)
def test_what_cannot_be_seen_is_refused_before_anything_is_written(capsys, tmp_path, arguments, message):
    out = tmp_path / "run"
    assert message in rejected(capsys, ["--preset", "smoke", "--reward", "xirl", *arguments, "--out", out])
    assert not out.exists()


def test_a_policy_that_decides_seldom_and_is_paid_for_progress_trains_like_any_other(tmp_path):
    out, steps = tmp_path / "run", 5
    arguments = ["--reward", "env", "--ppo.decision-steps", steps, "--ppo.progress", True, "--ppo.initial-std", 0.4]
    call(cli.train_main, *TRAIN, *arguments, "--out", out)
    summary = json.loads((out / "summary.json").read_text())
    config = json.loads((out / "config.json").read_text())["ppo_config"]
    assert (config["decision_steps"], config["progress"], config["initial_std"]) == (steps, True, 0.4)
    updates, envs, unroll = 4, config["num_envs"], config["unroll_length"]
    assert summary["env_steps"] == updates * envs * unroll * steps
    records = [json.loads(line) for line in (out / "metrics.jsonl").read_text().splitlines()]
    assert [row["env_steps"] for row in records] == [summary["env_steps"] // 2, summary["env_steps"]]
    # Episodes of 30 control steps: returns are those of the plain reward, which is paid at each of them.
    ended = [row for row in records if row["episodes"]]
    assert ended and all(0 < row["episode_length"] <= 30 and row["episode_length"] % steps == 0 for row in ended)
    outcome = call(cli.main, "evaluate", out, "--episodes", "16", "--video-episodes", "1")
    assert np.isfinite(outcome["mean_return"]) and (out / "evaluation_7.mp4").stat().st_size > 1000


def test_demonstrations_need_images_of_the_size_that_is_looked_at(capsys, tmp_path):
    out, file = tmp_path / "run", tmp_path / "demos.npz"
    call(cli.main, "demos", "--task", "carry", "--num", "4", "--images", "16", "--out", file)
    message = rejected(capsys, [*TRAIN, "--reward", "xirl", "--demos", file, "--out", out])
    assert "frames must be images of 32 x 32 pixels, got those of 16 x 16" in message
    assert not out.exists()


def test_a_tracker_whose_package_is_missing_is_refused_before_anything_is_written(capsys, monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "wandb", None)
    message = rejected(capsys, [*TRAIN, "--track", "wandb", "--out", tmp_path / "run"])
    assert 'pip install "graphrl_jax[wandb]"' in message and not (tmp_path / "run").exists()


def test_a_tracked_training_sends_every_line_of_its_log(tmp_path):
    out = tmp_path / "run"
    call(cli.train_main, *TRAIN, "--reward", "env", "--track", "tensorboard", "--out", out)
    lines = [json.loads(line) for line in (out / "metrics.jsonl").read_text().splitlines()]
    sent = numbers(out / "tensorboard", "policy")
    assert sent.keys() == {line["env_steps"] for line in lines}
    for line in lines:
        said = {f"policy/{name}": value for name, value in line.items() if name != "stage" and value is not None}
        assert sent[line["env_steps"]] == pytest.approx(said, rel=1e-6)
    summary = json.loads((out / "summary.json").read_text())
    (last,) = numbers(out / "tensorboard", "summary").values()
    assert last["summary/mean_return"] == pytest.approx(summary["mean_return"])


def test_a_finished_run_is_tracked_afterwards_and_once(finished, tmp_path):
    out = tmp_path / "run"
    shutil.copytree(finished, out)
    arguments = ["--resume", "--track", "tensorboard", "--out", out]
    call(cli.train_main, *arguments)
    sent = logged(out / "tensorboard")
    images = {name: value for _, name, value in sent if isinstance(value, bytes)}
    figures = {f"figures/{path.stem}": path.read_bytes() for path in (finished / "figures").iterdir()}
    assert images.pop("videos/rollout")[:4] == b"GIF8" and images == figures
    call(cli.train_main, *arguments)
    assert logged(out / "tensorboard") == sent


def test_of_several_processes_the_first_one_tracks(finished, tmp_path, monkeypatch):
    monkeypatch.setattr(sharding, "join", lambda *_: None)
    for process, folder in enumerate(("run", "run.process_1")):
        shutil.copytree(finished, tmp_path / folder)
        several = ["--coordinator", "localhost:1", "--processes", 2, "--process", process]
        call(cli.train_main, "--resume", "--track", "tensorboard", "--out", tmp_path / "run", *several)
        assert (tmp_path / folder / "tensorboard").exists() == (process == 0)


def test_a_tracker_that_fails_does_not_stop_the_command(finished, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(event_file_writer, "EventsWriter", None)
    out = tmp_path / "run"
    shutil.copytree(finished, out)
    answer = call(cli.train_main, "--resume", "--track", "tensorboard", "--out", out)
    assert answer["out"] == str(out)
    assert capsys.readouterr().err.count("warning: tensorboard failed and tracks this run no longer: TypeError") == 1
