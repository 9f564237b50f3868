"""`graphrl pretrain`: an encoder alone."""

import json
from dataclasses import replace

import jax
import numpy as np
import pytest

from graphrl_jax import cli
from graphrl_jax.experiment.run_directory import Run
from graphrl_jax.experiment.train_encoder import EncoderJob
from graphrl_jax.pretrain.config import PretrainHyper
from graphrl_jax.registry import make_task
from graphrl_jax.reward.model import RewardModel
from tests.helpers.commands import call, rejected

pytestmark = pytest.mark.usefixtures("outside_package")


def test_an_encoder_that_tells_no_frames_apart_is_told_of(capsys, demos_file, tmp_path):
    for temperature, said in (("1e6", True), ("0.01", False)):
        asked = ("--steps", 40, "--pretrain.temperature", temperature)
        call(cli.main, "pretrain", "--demos", demos_file, "--out", tmp_path / temperature, *asked)
        warning = f"warning: {temperature} maps all frames to nearly one point, so its reward means nothing"
        assert (warning in capsys.readouterr().err.replace("\n", " ")) == said


def test_an_encoder_alone_is_trained_and_audited(capsys, demos_file, tmp_path):
    out = tmp_path / "encoder"
    call(cli.main, "pretrain", "--demos", demos_file, "--out", out, "--steps", 20)
    log = capsys.readouterr().err
    assert log.index("pretraining: 20 of 20  loss") < log.index("auditing encoder")
    summary = json.loads((out / "summary.json").read_text())
    assert set(summary["trajectory_scores"]["by_kind"]) == {"success", "idle"}
    assert (out / "figures" / "landscape.png").exists()
    model = RewardModel.load(out)
    assert (model.card.task, model.card.demonstrations) == ("carry", 4)
    card = (out / "README.md").read_text()
    rows = [line.split(" | ") for line in card.partition("| measure |")[2].splitlines()[2:] if line[:1] == "|"]
    assert "| pair_accuracy |" in card and len(rows) > 5 and all(row[3].strip(" |") for row in rows)
    assert "kendall_tau" in card and "cycle_consistency" not in card  # which needs three held-out demonstrations
    assert summary["discrimination"]["failures"] == 2 and 0 <= summary["discrimination"]["auroc"] <= 1
    assert json.loads((out / "subtasks.json").read_text())["judged"] == summary["subtasks"]
    config = json.loads((out / "config.json").read_text())
    assert (config["command"], config["reward"], config["pretrain_config"]["steps"]) == ("pretrain", "graph", 20)


def test_a_reward_without_encoder_is_one_sentence(capsys, demos_file, tmp_path):
    out = tmp_path / "run"
    message = rejected(capsys, ["pretrain", "--demos", demos_file, "--out", out, "--reward", "env"], main=cli.main)
    assert "reward 'env' has no encoder to train" in message and not out.exists()


@pytest.mark.parametrize(
    ("chosen", "says"),
    [([0, 1], "holds 2 successes; allowed: 3 or more"), ([2, 2, 2], "demonstration 0 has 1 frame; allowed: 2 or more")],
)
@pytest.mark.parametrize("command", ["pretrain", "train"])
def test_demonstrations_that_teach_nothing_are_refused_before_a_folder_exists(capsys, tmp_path, command, chosen, says):
    demos = make_task("carry").demonstrate(jax.random.key(0), 3)
    demos = replace(demos, lengths=np.array([30, 30, 1], np.int32), events=None, event_names=()).select(chosen)
    demos.save(tmp_path / "demos.npz")
    out = tmp_path / "run"
    options = ["--task", "carry"] if command == "train" else []
    arguments = [command, "--demos", tmp_path / "demos.npz", "--out", out, *options]
    assert says in rejected(capsys, arguments, main=cli.main) and not out.exists()


def test_an_encoder_is_not_scored_on_what_it_is_trained_on(tmp_path):
    demos = make_task("carry").demonstrate(jax.random.key(0), 6, 2)
    job = EncoderJob(Run(tmp_path), demos, PretrainHyper(), seed=3)
    fitted, held_out = job.split
    together = np.concatenate([held_out.boxes, demos.boxes[~demos.success]])
    np.testing.assert_array_equal(np.sort(job.unseen.boxes, axis=0), np.sort(together, axis=0))
    assert len(job.unseen) + len(fitted) == len(demos)


def test_demonstrations_of_another_frame_rate_are_resampled_and_the_log_says_so(tmp_path, capsys):
    task = make_task("carry")
    demos = task.demonstrate(jax.random.key(0), 4, 2)
    replace(demos, frame_rate=2 * demos.frame_rate).save(tmp_path / "demos.npz")
    call(cli.main, "pretrain", "--demos", tmp_path / "demos.npz", "--out", tmp_path / "run", "--steps", 20)
    assert f"resampled from {2 * task.frame_rate:g} to {task.frame_rate:g} frames per second" in capsys.readouterr().err
