"""The run directory: what it refuses, and what it keeps of a log."""

import json
import math

import pytest

from graphrl_jax.experiment.run_directory import Run, RunError
from graphrl_jax.experiment.settings import compose
from graphrl_jax.registry import make_task
from graphrl_jax.storage import StorageError
from tests.helpers.commands import contents

pytestmark = pytest.mark.usefixtures("outside_package")
GONE = "gone"


@pytest.fixture
def started(tmp_path):
    """A run that has done nothing yet, and its settings."""
    settings = compose(make_task("carry"), "graphirl", "smoke", seed=3)
    return Run.start(tmp_path / "run", settings), settings


def change(run: Run, **fields: object) -> None:
    """Rewrites some fields of config.json; `GONE` takes one away."""
    path = run.path / "config.json"
    config = json.loads(path.read_text()) | fields
    path.write_text(json.dumps({name: value for name, value in config.items() if value != GONE}))


def test_settings_come_back(started):
    run, settings = started
    assert Run(run.path).settings() == settings
    config = json.loads((run.path / "config.json").read_text())
    assert (config["command"], config["version"], config["seed"]) == ("train", 2, 3) and "commit" in config


@pytest.mark.parametrize("fields", [{"version": 1}, {"version": GONE}, {"command": "sweep"}, {"command": GONE}])
def test_a_config_of_another_version_or_command_is_refused_with_one_sentence(started, fields):
    run, _ = started
    change(run, **fields)
    with pytest.raises(RunError) as refused:
        run.settings()
    (field, value), message = next(iter(fields.items())), str(refused.value)
    assert (
        f"{run.path}/config.json is of command " in message
        and f"{field} {None if value == GONE else value!r}" in message
    )
    assert message.endswith("allowed: 'train', version 2") and "\n" not in message


def test_a_damaged_config_names_the_field(started):
    run, _ = started
    change(run, seed=GONE)
    with pytest.raises(RunError, match=r"config.json: settings: seed is missing"):
        run.settings()
    change(run, seed=0, updates="many")
    with pytest.raises(RunError, match="config.json"):
        run.settings()


def test_a_folder_without_config_is_no_run(tmp_path):
    with pytest.raises(StorageError, match=r"config.json is missing: .* holds no run"):
        Run(tmp_path).settings()


def test_a_folder_that_holds_something_is_left_alone(tmp_path, started):
    run, settings = started
    (tmp_path / "file").write_text("words")
    before = contents(tmp_path)
    for path in (run.path, tmp_path / "file"):
        with pytest.raises(RunError, match=f"--out {path} is not empty; choose another folder"):
            Run.start(path, settings)
    assert contents(tmp_path) == before
    (tmp_path / "empty").mkdir()
    assert Run.start(tmp_path / "empty", settings).settings() == settings


def test_a_log_forgets_what_lies_behind_the_checkpoint_and_lines_cut_short(started):
    run, _ = started
    assert run.records("ppo") == []
    run.forget_after("ppo", "update", 0)  # nothing is logged yet
    for step in (10, 20):
        run.log({"stage": "pretrain", "step": step})
    for update in (2, 4, 6):
        run.log({"stage": "ppo", "update": update})
    with (run.path / "metrics.jsonl").open("a") as file:
        file.write('{"stage": "ppo", "upd')
    assert [record["update"] for record in run.records("ppo")] == [2, 4, 6]
    run.forget_after("ppo", "update", 4)
    assert [record["update"] for record in run.records("ppo")] == [2, 4]
    assert [record["step"] for record in run.records("pretrain")] == [10, 20]


def test_values_that_are_not_finite_are_null_in_the_log_and_come_back_as_nan(started):
    run, _ = started
    run.log({"stage": "ppo", "update": 1, "success": float("nan"), "reward": float("inf"), "name": "x"})
    text = (run.path / "metrics.jsonl").read_text()
    assert json.loads(text, parse_constant=pytest.fail)["success"] is None
    (record,) = run.records("ppo")
    assert math.isnan(record["success"]) and math.isnan(record["reward"]) and record["name"] == "x"
