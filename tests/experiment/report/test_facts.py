"""The facts of a run, finished or not, and of folders that hold none."""

import json
import shutil

import numpy as np
import pytest

from graphrl_jax.demonstrations import load
from graphrl_jax.experiment.report.facts import read_facts
from graphrl_jax.experiment.run_directory import RunError
from graphrl_jax.experiment.train_encoder import EncoderJob
from graphrl_jax.reward.model import RewardModel
from graphrl_jax.storage import StorageError
from tests.helpers.commands import finished_run

pytestmark = pytest.mark.usefixtures("outside_package")


@pytest.fixture(scope="module")
def finished(outside_package, tmp_path_factory):
    return finished_run(tmp_path_factory.getbasetemp())


@pytest.fixture
def copied(finished, tmp_path):
    """A finished run that a test may change."""
    return shutil.copytree(finished, tmp_path / "run")


def test_held_out_progress_is_that_of_the_reward_on_what_the_encoder_has_not_seen(finished):
    facts = read_facts(finished)
    job = EncoderJob(facts.run, load(finished / "demonstrations.npz"), facts.settings.pretrain, facts.settings.seed)
    unseen, model = job.unseen, RewardModel.load(finished)
    assert facts.held_out.success.tolist() == unseen.success.tolist() and facts.no_held_out == ""
    for number, curve in enumerate(facts.held_out.progress):
        length = unseen.lengths[number]
        expected = np.clip(
            1 + np.asarray(model.rewards(unseen.boxes[number, :length], unseen.mask[number, :length])), 0, 1
        )
        np.testing.assert_allclose(curve, expected, atol=1e-5)
        assert facts.held_out.like_success[number] == (curve[-1] >= facts.held_out.level)


def test_a_finished_run_has_everything(finished):
    facts = read_facts(finished)
    assert facts.evaluated and facts.trains_policy and facts.learns_reward and facts.updates == 4
    assert facts.video == finished / "rollout.mp4"
    assert facts.figures.keys() == {"landscape", "reward_on_rollouts", "reward_on_demonstrations"}


def test_what_an_unfinished_run_lacks_is_empty(copied):
    for name in ("summary.json", "encoder.json", "demonstrations.npz", "subtasks.json", "rollout.mp4", "metrics.jsonl"):
        (copied / name).unlink()
    shutil.rmtree(copied / "figures")
    (copied / "evaluation_7.mp4").write_bytes(b"video")
    facts = read_facts(copied)
    assert not (facts.summary or facts.encoder or facts.subtasks or facts.ppo or facts.pretrain or facts.figures)
    assert facts.updates == 0 and not facts.evaluated and facts.video == copied / "evaluation_7.mp4"
    assert facts.held_out is None and "there is no such file" in facts.no_held_out


def test_other_demonstrations_than_those_of_the_training_give_no_curves(copied):
    file = copied / "demonstrations.npz"
    load(file).select([0, 1, 2, 3, 4, 8, 9]).save(file)
    facts = read_facts(copied)
    assert facts.held_out is None and "holds other demonstrations" in facts.no_held_out


def test_a_folder_without_a_run_is_one_sentence_that_names_it(copied, tmp_path):
    with pytest.raises(StorageError, match=f"{tmp_path}/none/config.json is missing: {tmp_path}/none holds no run"):
        read_facts(tmp_path / "none")
    (copied / "summary.json").write_text("[]")
    with pytest.raises(RunError, match=r"summary.json holds list; allowed: an object"):
        read_facts(copied)
    config = json.loads((copied / "config.json").read_text())
    (copied / "config.json").write_text(json.dumps(config | {"command": "sweep"}))
    with pytest.raises(RunError, match="is of command 'sweep', version 2; allowed: 'train' or 'pretrain'"):
        read_facts(copied)
