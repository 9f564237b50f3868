"""Rho and its companions, by hand."""

import numpy as np
import pytest

from graphrl_jax.reward.discrimination import discrimination

REWARDS = np.array([[-1.0, -0.5, 0.0, -9.0], [-1.0, -1.0, -1.0, -1.0], [-1.0, 0.0, -9.0, -9.0]])
LENGTHS = np.array([3, 4, 2])
SUCCESS = np.array([True, False, True])


def test_by_hand():
    found = discrimination(REWARDS, LENGTHS, SUCCESS)
    assert found["rho"] == pytest.approx((-1.5 - 1.0) / 2 / -4.0)
    assert found["rho_per_step"] == pytest.approx((-0.5 - 0.5) / 2 / -1.0)
    assert found["auroc"] == found["auroc_per_step"] == 1.0 and found["final_auroc"] == 1.0
    assert found["order_success"] == pytest.approx(1.0) and found["order_failure"] == 0.0
    assert (found["successes"], found["failures"]) == (2, 1)


def test_a_loss_that_comes_late_counts_less_with_discount():
    early, late = np.zeros(200), np.zeros(200)
    early[0], late[99:] = -2.0, -0.03
    found = discrimination(np.stack([early, late]), np.array([200, 200]), np.array([True, False]))
    assert found["auroc"] == 1.0 and found["auroc_discounted"] == 0.0


def test_padding_means_nothing():
    changed = np.where(np.arange(4) < LENGTHS[:, None], REWARDS, 123.0)
    assert discrimination(changed, LENGTHS, SUCCESS) == discrimination(REWARDS, LENGTHS, SUCCESS)


@pytest.mark.parametrize("success", [np.ones(3, bool), np.zeros(3, bool)])
def test_it_takes_both_kinds(success):
    with pytest.raises(ValueError, match="needs successes and failures, got"):
        discrimination(REWARDS, LENGTHS, success)
