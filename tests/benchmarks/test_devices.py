"""Rewards on two devices: what their differences are reported as."""

import numpy as np
import pytest

from benchmarks.devices import differences, rewards_on
from tests.helpers.reward_models import DEMOS, small_model


def test_differences_count_frames_that_were_shown_alone():
    here, there = np.array([[-1.0, -0.5, 9.0], [-2.0, 0.0, 0.0]]), np.array([[-1.0, -0.75, 0.0], [-2.25, 0.5, 0.0]])
    found = differences(here, there, np.array([2, 1]))
    assert found == {"frames": 3, "largest_difference": 0.25, "mean_difference": 0.5 / 3, "rewards": [-2.0, -0.5]}


def test_rewards_are_those_of_every_demonstration():
    model = small_model()
    rewards = rewards_on("cpu", model, DEMOS)
    assert rewards.shape == DEMOS.boxes.shape[:2]
    assert rewards[0, : DEMOS.lengths[0]] == pytest.approx(
        np.asarray(model.rewards(DEMOS.boxes[0], DEMOS.mask[0]))[: DEMOS.lengths[0]], abs=1e-6
    )
