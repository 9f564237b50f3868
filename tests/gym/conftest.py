"""Gymnasium's registry and the released reward model of Match Regions."""

import pytest

from graphrl_jax.gym import register_tasks
from graphrl_jax.reward.model import RewardModel
from tests.helpers.outside_package import REPOSITORY


@pytest.fixture(scope="session")
def model() -> RewardModel:
    return RewardModel.load(REPOSITORY / "checkpoints" / "match_regions_graph")


@pytest.fixture(scope="module")
def carry(outside_package) -> str:
    """Identifier of the example task of docs/examples: 30 steps, and quick to compile."""
    register_tasks()
    return "graphrl/Carry-v0"
