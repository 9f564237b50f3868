"""The commands end to end, on a task that lives in a package outside the repository."""

import contextlib
import io
import json
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from graphrl_jax import cli, pipeline
from graphrl_jax.demonstrations import load

pytestmark = pytest.mark.usefixtures("outside_package")
TRAIN = ["--task", "carry", "--preset", "smoke"]

# Dies without a word as soon as the file named first has been written.
DIES_AFTER = """
import os, signal, sys
from graphrl_jax import cli, training
save = training.save_tree
def save_and_die(path, tree):
    save(path, tree)
    if path.name == sys.argv[1]:
        os.kill(os.getpid(), signal.SIGKILL)
training.save_tree = save_and_die
cli.train_main(sys.argv[2:])
"""


def call(main, *arguments: object) -> dict:
    """Runs a command in this process; returns the one JSON line that it prints."""
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        main([str(argument) for argument in arguments])
    (line,) = printed.getvalue().splitlines()
    return json.loads(line)


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A run that was never interrupted."""
    out = tmp_path_factory.mktemp("runs") / "finished"
    call(cli.train_main, *TRAIN, "--out", out)
    return out


def numbers(run: Path) -> dict:
    """The summary without what depends on the clock or on interruptions."""
    summary = json.loads((run / "summary.json").read_text())
    summary["encoder"].pop("pretrain_s", None)
    timing = ("wall_s", "compile_s", "compilation_cache", "resumed", "train_steps_per_s")
    return {name: value for name, value in summary.items() if name not in timing}


def arrays(path: Path) -> dict[str, np.ndarray]:
    with np.load(path) as file:
        return dict(file)


def test_a_run_directory_holds_everything(finished):
    files = {str(path.relative_to(finished)) for path in finished.rglob("*") if path.is_file()}
    assert files == {
        "config.json", "metrics.jsonl", "summary.json", "demonstrations.npz", "encoder.npz", "encoder.json",
        "stages.json", "policy.npz", "train_state.npz", "rollout.mp4", "figures/learning_curve.png",
        "figures/landscape.png", "figures/reward_on_demonstrations.png", "figures/reward_on_rollouts.png",
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


@pytest.mark.parametrize("file", ["encoder.npz", "train_state.npz"])
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


def test_evaluate_prints_one_json_line_and_writes_a_video(finished):
    arguments = ["evaluate", finished, "--episodes", 16, "--seed", 3]
    first, second = call(cli.main, *arguments), call(cli.main, *arguments, "--video-episodes", 0)
    assert first == second
    assert first.keys() == {"success_rate", "mean_score", "episodes", "mean_return", "seed"}
    assert (first["episodes"], first["seed"]) == (16, 3)
    assert (finished / "evaluation_3.mp4").stat().st_size > 1000


def test_a_command_prints_nothing_but_its_line(tmp_path):
    """In a process of its own: what libraries print while they are imported counts too."""
    command = [sys.executable, "-m", "graphrl_jax", "demos", "--task", "carry", "--out", tmp_path / "demos.npz"]
    printed = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert json.loads(printed)["demonstrations"] == 64


def test_demonstrations_and_encoder_alone(demos_file, tmp_path):
    demos, out = load(demos_file), tmp_path / "encoder"
    assert (len(demos), int(demos.success.sum()), demos.task) == (8, 6, "carry")
    call(cli.main, "pretrain", "--demos", demos_file, "--out", out, "--steps", 20)
    summary = json.loads((out / "summary.json").read_text())
    assert set(summary["trajectory_scores"]["by_kind"]) == {"success", "idle"}
    assert (out / "encoder.npz").exists() and (out / "figures" / "landscape.png").exists()
    assert summary["discrimination"]["failures"] == 2 and 0 <= summary["discrimination"]["auroc"] <= 1
    assert json.loads((out / "stages.json").read_text())["judged"] == summary["stages"]


@pytest.mark.parametrize("method", pipeline.STAGE_METHODS)
def test_stages_of_demonstrations_without_labels(demos_file, tmp_path, finished, method):
    bare = replace(load(demos_file), events=None, event_names=(), kinds=None)
    file, out = tmp_path / "bare.npz", tmp_path / "stages.json"
    bare.save(file)
    printed = call(cli.main, "stages", finished, "--demos", file, "--method", method, "--out", out)
    assert printed == {"out": str(out), "demonstrations": len(bare)}
    rows = json.loads(out.read_text())["stages"]
    assert [row["length"] for row in rows] == bare.lengths.tolist()
    for row in rows:
        assert all(0 < frame < row["length"] for frame in row["boundaries"])
        np.testing.assert_allclose(np.array(row["seconds"]) * bare.frame_rate, row["boundaries"])


def test_an_unknown_way_to_find_stages_is_one_sentence(capsys, demos_file, finished):
    message = rejected(capsys, ["stages", finished, "--demos", demos_file, "--method", "guess"], cli.main)
    assert "'guess'" in message and "change_points" in message


@pytest.fixture(scope="module")
def demos_file(tmp_path_factory):
    file = tmp_path_factory.mktemp("demos") / "demos.npz"
    call(cli.main, "demos", "--task", "carry", "--num", 6, "--failures", 2, "--out", file)
    return file


def rejected(capsys, arguments: list, main=cli.train_main) -> str:
    """The one sentence with which a request is turned down."""
    with pytest.raises(SystemExit) as stop:
        main([str(argument) for argument in arguments])
    assert stop.value.code == 2
    printed = capsys.readouterr()
    assert printed.out == "" and printed.err.startswith("error: ") and printed.err.count("\n") == 1
    return printed.err


@pytest.mark.parametrize(
    "arguments, names",
    [
        (["--task", "juggling"], ["'juggling'", "match_regions"]),
        (["--reward", "money"], ["'money'", "graph_with_robot"]),
        (["--preset", "huge"], ["'huge'", "smoke"]),
        (["--updates", "0"], ["updates is 0", "1 or more"]),
        (["--demos", "nowhere.npz"], ["nowhere.npz"]),
        (["--resume"], ["--out"]),
    ],
)
def test_a_wrong_request_is_one_sentence(capsys, monkeypatch, tmp_path, arguments, names):
    monkeypatch.chdir(tmp_path)
    message = rejected(capsys, arguments)
    assert all(name in message for name in names), message
    assert not list(tmp_path.iterdir())


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


def test_a_folder_that_holds_another_run_is_left_alone(capsys, finished):
    before = {path: path.read_bytes() for path in finished.rglob("*") if path.is_file()}
    assert str(finished) in rejected(capsys, ["--out", finished])
    assert {path: path.read_bytes() for path in finished.rglob("*") if path.is_file()} == before


def test_demonstrations_are_not_overwritten(capsys, demos_file):
    before = demos_file.read_bytes()
    message = rejected(capsys, ["demos", "--task", "carry", "--out", demos_file], main=cli.main)
    assert str(demos_file) in message and demos_file.read_bytes() == before


def test_evaluating_what_is_no_run_is_one_sentence(capsys, tmp_path):
    assert "config.json" in rejected(capsys, ["evaluate", tmp_path], main=cli.main)
