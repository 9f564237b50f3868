"""A reward model's folder: it travels, it says what it takes, and what is wrong with it is named."""

import json
import shutil
import subprocess
import sys
from dataclasses import replace

import jax
import numpy as np
import pytest

from graphrl_jax.encoder import encoder
from graphrl_jax.encoder.config import EncoderConfig
from graphrl_jax.encoder.pooling import PoolingParams
from graphrl_jax.reward.card import Card, read_card, write_card
from graphrl_jax.reward.model import RewardModel, demonstration_rewards, fit_reward
from graphrl_jax.storage import StorageError
from tests.helpers.demonstrations import demonstrations
from tests.helpers.graphs import OBJECTS

CONFIG = EncoderConfig(num_layers=1, hidden=4, embedding=3)
DEMOS = demonstrations(num=4, num_frames=10)
CARD = Card(OBJECTS, 8.0, CONFIG, "displacement", "sorting", "made up", 4, -0.1)
FRESH = """
import sys
import numpy as np
from graphrl_jax import RewardModel
with np.load(sys.argv[2]) as file:
    rewards = RewardModel.load(sys.argv[1]).rewards(file["boxes"], file["mask"])
np.save(sys.argv[3], rewards)
"""


@pytest.fixture(scope="module")
def model() -> RewardModel:
    params = jax.jit(encoder.init, static_argnums=(1, 2))(jax.random.key(0), CONFIG, OBJECTS)
    return replace(fit_reward(params, DEMOS, PoolingParams(alpha=2.0, tau=0.02)), card=CARD)


@pytest.fixture(scope="module")
def folder(model, tmp_path_factory):
    path = tmp_path_factory.mktemp("models") / "sorting"
    model.save(path, {"pair_accuracy": 0.5, "by_kind": {"a": 1}, "votes": 3})
    return path


def test_rewards_are_those_of_the_demonstrations(model):
    expected = demonstration_rewards(model, DEMOS)
    for number, length in enumerate(DEMOS.lengths):
        found = model.rewards(DEMOS.boxes[number, :length], DEMOS.mask[number, :length])
        np.testing.assert_allclose(found, expected[number, :length], atol=1e-6)


def test_a_folder_that_was_moved_gives_the_same_rewards_in_a_fresh_process(model, folder, tmp_path):
    moved, boxes, out = tmp_path / "elsewhere" / "model", tmp_path / "boxes.npz", tmp_path / "rewards.npy"
    shutil.copytree(folder, moved)
    np.savez(boxes, boxes=DEMOS.boxes[0], mask=DEMOS.mask[0])
    subprocess.run([sys.executable, "-c", FRESH, moved, boxes, out], check=True, cwd=tmp_path)
    np.testing.assert_allclose(np.load(out), model.rewards(DEMOS.boxes[0], DEMOS.mask[0]), atol=1e-6)
    assert RewardModel.load(moved).card == CARD


def test_people_can_read_the_card(folder):
    text = (folder / "README.md").read_text()
    assert "# Reward model for sorting" in text and "8 frames per second" in text
    meaning = "of two scenes, how often the one with less left to do has the higher reward"
    assert f"| pair_accuracy | 0.5 | above 0.8 | {meaning} |" in text and "by_kind" not in text
    assert "| votes | 3 |  |  |" in text
    for name in OBJECTS.names:
        assert f"| {name} |" in text


def test_other_entries_of_the_configuration_stay(tmp_path):
    (tmp_path / "config.json").write_text('{"seed": 3}')
    write_card(tmp_path, CARD, {})
    assert json.loads((tmp_path / "config.json").read_text())["seed"] == 3
    assert read_card(tmp_path) == CARD


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda card: card.pop("frame_rate"), "frame_rate is missing"),
        (lambda card: card.update(frame_rate="fast"), "frame_rate is 'fast'; allowed: float"),
        (lambda card: card["encoder"].update(kind="magic"), "EncoderConfig.kind must be one of"),
        (lambda card: card["objects"].update(names=["a"]), "ObjectTable.class_ids has"),
        (lambda card: card["encoder"].update(hidden=8), r"tree/params/\S+ is float32"),
    ],
)
def test_what_is_wrong_with_a_folder_is_named(folder, tmp_path, change, message):
    broken = tmp_path / "broken"
    shutil.copytree(folder, broken)
    content = json.loads((broken / "config.json").read_text())
    change(content["reward_model"])
    (broken / "config.json").write_text(json.dumps(content))
    with pytest.raises(StorageError, match=f"{broken}/(config.json|model.safetensors): .*{message}"):
        RewardModel.load(broken)


def test_what_is_missing_is_named(folder, tmp_path, model):
    with pytest.raises(StorageError, match="config.json is missing: .* holds no reward model"):
        RewardModel.load(tmp_path)
    (tmp_path / "config.json").write_text("{}")
    with pytest.raises(StorageError, match="has no reward_model"):
        RewardModel.load(tmp_path)
    write_card(tmp_path, CARD, {})
    with pytest.raises(StorageError, match="model.safetensors is missing"):
        RewardModel.load(tmp_path)
    (tmp_path / "model.safetensors").write_bytes((folder / "model.safetensors").read_bytes()[:100])
    with pytest.raises(StorageError, match="model.safetensors is damaged or no safetensors file"):
        RewardModel.load(tmp_path)
    with pytest.raises(ValueError, match="without card cannot be saved"):
        replace(model, card=None).save(tmp_path)
    with pytest.raises(ValueError, match=r"rewards takes boxes \(T, \d, 4\)"):
        model.rewards(np.zeros((3, 9, 4)), np.zeros((3, 9), bool))
