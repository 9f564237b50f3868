"""`graphrl sweep`: a folder of runs."""

import json

import pytest

from graphrl_jax import cli
from tests.helpers.commands import TRAIN, call, rejected
from tests.helpers.compilations import count_compilations

pytestmark = pytest.mark.usefixtures("outside_package")
SWEEP = ["sweep", *TRAIN]


def test_policies_of_a_sweep_are_trained_by_one_program_and_kept_as_runs(tmp_path, monkeypatch):
    compiled = count_compilations(monkeypatch)
    out = tmp_path / "sweep"
    values = ["--reward", "env", "--sweep", "ppo.learning_rate=1e-3,3e-3"]
    printed = call(cli.main, *SWEEP, *values, "--out", out)
    report = json.loads((out / "sweep.json").read_text())
    names = [row["member"] for row in report["members"]]
    assert (printed["members"], compiled) == (2, [2])
    assert names == ["learning_rate=0.001,seed=0", "learning_rate=0.003,seed=0"]
    assert [row["swept"] for row in report["members"]] == [{"ppo.learning_rate": rate} for rate in (1e-3, 3e-3)]
    assert (out / "figures" / "sweep.png").stat().st_size > 5000
    asked = json.loads((out / "config.json").read_text())["request"]
    assert asked["sweep"] == ["ppo.learning_rate=1e-3,3e-3"] and asked["updates"] is asked["pretrain"]["steps"] is None
    member = out / names[1]
    assert json.loads((member / "config.json").read_text())["ppo"]["learning_rate"] == 3e-3
    outcome = call(cli.main, "evaluate", member, "--episodes", "16", "--video-episodes", "0")
    assert outcome["episodes"] == 16

    # Nothing is left to do: the sweep ends with the same numbers.
    kept = (member / "policy.npz").read_bytes()
    call(cli.main, *SWEEP, "--out", out, "--resume")
    again = json.loads((out / "sweep.json").read_text())
    assert again["members"] == report["members"] and (member / "policy.npz").read_bytes() == kept


@pytest.mark.parametrize(
    "arguments, message",
    [
        (["--seeds", "0"], "--seeds is 0; allowed: 1 or more"),
        (["--alphas", "1,2", "--sweep", "pretrain.alpha=4"], "pretrain.alpha is given twice"),
        (["--reward", "env", "--alphas", "1,2"], "no field 'pretrain.alpha' to sweep with reward env"),
        (["--reward", "money"], "unknown reward 'money'"),
        (["--engine", "mjx"], "task 'carry' has one engine of its own; leave the engine 'mjx' out"),
        (["--resume"], "config.json is missing"),
    ],
)
def test_a_wrong_request_is_one_sentence(capsys, tmp_path, arguments, message):
    out = tmp_path / "sweep"
    assert message in rejected(capsys, [*SWEEP, *arguments, "--out", out], main=cli.main)
    assert not out.exists()


def test_floats_that_images_do_not_know_cannot_be_swept(tmp_path, capsys):
    arguments = ["sweep", "--task", "carry", "--reward", "xirl", "--alphas", "1,2", "--out", str(tmp_path / "sweep")]
    error = rejected(capsys, arguments, main=cli.main)
    assert "pretrain.alpha" in error and "pretrain.temperature" in error
