"""The released runs fit the code beside them: `graphrl evaluate checkpoints/NAME` works, with the trained weights."""

import itertools
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import jax
import numpy as np
import pytest

from graphrl_jax.experiment.checkpoints import load_run
from graphrl_jax.experiment.evaluation import evaluate_policy
from graphrl_jax.experiment.run_directory import Run
from graphrl_jax.graph import build_graph
from graphrl_jax.registry import make_task
from graphrl_jax.reward.model import RewardModel, load_parameters
from graphrl_jax.storage import StorageError
from tasks.engine import default_engine

CHECKPOINTS = Path(__file__).parents[2] / "checkpoints"
RELEASED = sorted(CHECKPOINTS.iterdir())
GRAPH_RUN = Run(CHECKPOINTS / "match_regions_graph")
GOLDEN = json.loads((Path(__file__).parent / "golden" / "match_regions_graph.json").read_text())
"""Graphs of worlds arranged by hand, from the start to both targets placed, and the released reward of each."""
REWARDS = np.array([world["reward"] for world in GOLDEN.values()])


@pytest.mark.parametrize("folder", RELEASED, ids=lambda folder: folder.name)
def test_a_released_run_loads_and_is_small(folder):
    trained = load_run(folder)
    assert f"{trained.task.name}_{trained.settings.reward}" == folder.name
    assert sum(file.stat().st_size for file in folder.rglob("*")) < 2e6


def test_a_run_is_loaded_with_any_engine():
    names = [load_run(RELEASED[0], engine).task.engine.name for engine in ("mjx", "mujoco", None)]
    assert names == ["mjx", "mujoco", default_engine()]


@pytest.fixture(scope="module")
def released() -> RewardModel:
    """The released reward."""
    settings = GRAPH_RUN.settings()
    config = settings.pretrain_config
    return load_parameters(GRAPH_RUN.path, config.encoder, config.activity, make_task(settings.task).objects)


@pytest.fixture(scope="module")
def rewards_of() -> Callable[[RewardModel], np.ndarray]:
    """Rewards of all worlds under a model."""
    objects = make_task("match_regions").objects
    seen = [np.array([world[name] for world in GOLDEN.values()]) for name in ("boxes", "mask", "active")]
    graphs = jax.vmap(lambda *frame: build_graph(objects, *frame))(seen[0].astype(np.float32), *seen[1:])
    return jax.jit(lambda model: jax.vmap(model.apply)(graphs))


def agrees(rewards: np.ndarray) -> bool:
    """Whether these are the released rewards."""
    return np.allclose(rewards, REWARDS, rtol=0.0, atol=1e-4)


def test_the_released_reward_is_the_one_that_was_trained(released, rewards_of):
    np.testing.assert_allclose(rewards_of(released), REWARDS, rtol=0.0, atol=1e-4)
    placed = {name: world["reward"] for name, world in GOLDEN.items()}
    assert placed["nothing moved"] < placed["star half way"] < placed["star placed"] < placed["both placed"]


def test_permuted_weights_are_not_the_released_reward(released, rewards_of):
    leaves, structure = jax.tree.flatten(released.params)
    swapped = 0
    for i, j in itertools.combinations(range(len(leaves)), 2):
        if leaves[i].ndim == 2 and leaves[i].shape == leaves[j].shape:
            permuted = list(leaves)
            permuted[i], permuted[j] = leaves[j], leaves[i]
            assert not agrees(rewards_of(replace(released, params=jax.tree.unflatten(structure, permuted)))), (i, j)
            swapped += 1
    assert swapped > 50


def test_a_checkpoint_of_other_sizes_is_refused_by_the_name_of_a_leaf(tmp_path):
    settings = GRAPH_RUN.settings()
    config = settings.pretrain_config
    wider = replace(config.encoder, hidden=2 * config.encoder.hidden)
    objects = make_task(settings.task).objects
    with pytest.raises(StorageError, match=r"model.safetensors: tree/params/\S+ is float32\["):
        load_parameters(GRAPH_RUN.path, wider, config.activity, objects)
    with pytest.raises(StorageError, match="model.safetensors is missing"):
        load_parameters(tmp_path, config.encoder, config.activity, objects)


def test_the_folder_of_a_run_is_that_of_its_reward_model(released, rewards_of):
    loaded = RewardModel.load(GRAPH_RUN.path)
    np.testing.assert_array_equal(rewards_of(replace(loaded, card=None)), rewards_of(released))
    settings = GRAPH_RUN.settings()
    assert loaded.card.encoder == settings.pretrain_config.encoder and loaded.card.task == settings.task
    assert loaded.card.objects == make_task(settings.task).objects


@pytest.mark.slow
@pytest.mark.parametrize("folder", RELEASED, ids=lambda folder: folder.name)
def test_a_released_policy_solves_unseen_episodes(folder):
    outcome = evaluate_policy(load_run(folder), episodes=32, seed=7)
    least = 0.8 if folder.name == "shoes_in_box_graph" else 1.0
    assert least <= outcome["success_rate"] <= outcome["mean_score"] <= 1.0
