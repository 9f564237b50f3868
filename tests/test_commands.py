"""The commands end to end, on a task that lives in a package outside the repository."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from graphrl_jax import cli
from graphrl_jax.demonstrations import load

REPOSITORY = Path(__file__).parents[1]
OUTSIDE_PACKAGE = Path(__file__).parent / "outside_package"
TRAIN = ["train.py", "--task", "carry", "--preset", "smoke"]

# Dies without a word as soon as the file named first has been written.
DIES_AFTER = """
import os, signal, sys
from graphrl_jax import cli, pipeline
save = pipeline.save_tree
def save_and_die(path, tree):
    save(path, tree)
    if path.name == sys.argv[1]:
        os.kill(os.getpid(), signal.SIGKILL)
pipeline.save_tree = save_and_die
cli.train_main(sys.argv[2:])
"""


@pytest.fixture(scope="session")
def command(tmp_path_factory):
    """Runs Python in the repository with the outside package installed; programs compiled once are shared."""
    paths = [str(REPOSITORY), str(OUTSIDE_PACKAGE)]
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join(paths),
        "JAX_COMPILATION_CACHE_DIR": str(tmp_path_factory.mktemp("cache")),
        "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0",
        "JAX_DISABLE_MOST_OPTIMIZATIONS": "1",
    }

    def run(*args: object) -> subprocess.CompletedProcess:
        return subprocess.run(
            [sys.executable, *map(str, args)], cwd=REPOSITORY, env=environment, capture_output=True, text=True
        )

    return run


@pytest.fixture(scope="session")
def finished(command, tmp_path_factory):
    """A run that was never interrupted."""
    out = tmp_path_factory.mktemp("runs") / "finished"
    result = command(*TRAIN, "--out", out)
    assert result.returncode == 0, result.stderr
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
        "policy.npz", "train_state.npz", "rollout.mp4", "figures/learning_curve.png", "figures/landscape.png",
        "figures/reward_on_demonstrations.png", "figures/reward_on_rollouts.png",
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
    assert {"env_reward", "graph_reward", "distance", "success"} <= policy_records[0].keys()


@pytest.mark.parametrize("file", ["encoder.npz", "train_state.npz"])
def test_a_killed_run_resumes_to_the_same_numbers(command, finished, tmp_path, file):
    out = tmp_path / "killed"
    killed = command("-c", DIES_AFTER, file, *TRAIN[1:], "--out", out)
    assert killed.returncode == -signal.SIGKILL, killed.stderr
    assert not (out / "summary.json").exists()
    resumed = command("train.py", "--out", out, "--resume")
    assert resumed.returncode == 0, resumed.stderr
    assert numbers(out) == numbers(finished)
    expected, found = arrays(finished / "train_state.npz"), arrays(out / "train_state.npz")
    assert expected.keys() == found.keys()
    for name, array in expected.items():
        np.testing.assert_array_equal(found[name], array, err_msg=name)


def test_evaluate_prints_one_json_line_and_writes_a_video(command, finished):
    results = [command("-m", "graphrl_jax", "evaluate", finished, "--episodes", 16, "--seed", 3) for _ in range(2)]
    first, second = (json.loads(result.stdout) for result in results)
    assert first == second
    assert first.keys() == {"success_rate", "mean_score", "episodes", "mean_return", "seed"}
    assert (first["episodes"], first["seed"]) == (16, 3)
    assert (finished / "evaluation_3.mp4").stat().st_size > 1000


def test_demonstrations_and_encoder_alone(command, tmp_path):
    file, out = tmp_path / "demos.npz", tmp_path / "encoder"
    made = command("-m", "graphrl_jax", "demos", "--task", "carry", "--num", 6, "--failures", 2, "--out", file)
    assert made.returncode == 0, made.stderr
    demos = load(file)
    assert (len(demos), int(demos.success.sum()), demos.task) == (8, 6, "carry")
    before = file.read_bytes()
    again = command("-m", "graphrl_jax", "demos", "--task", "carry", "--out", file)
    assert (again.returncode, file.read_bytes()) == (2, before)
    trained = command("-m", "graphrl_jax", "pretrain", "--demos", file, "--out", out, "--steps", 20)
    assert trained.returncode == 0, trained.stderr
    summary = json.loads((out / "summary.json").read_text())
    assert set(summary["trajectory_scores"]["by_kind"]) == {"success", "idle"}
    assert (out / "encoder.npz").exists() and (out / "figures" / "landscape.png").exists()


@pytest.fixture(scope="session")
def demos_file(command, tmp_path_factory):
    file = tmp_path_factory.mktemp("demos") / "demos.npz"
    assert command("-m", "graphrl_jax", "demos", "--task", "carry", "--num", 4, "--out", file).returncode == 0
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


def test_evaluating_what_is_no_run_is_one_sentence(capsys, tmp_path):
    assert "config.json" in rejected(capsys, ["evaluate", tmp_path], main=cli.main)
