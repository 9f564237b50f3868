"""Episodes of a policy on the probe, whose returns are known."""

from dataclasses import replace

import jax
import numpy as np

from graphrl_jax.rl import ppo
from graphrl_jax.rl.rollout import evaluate
from tests.helpers.probe_training import ACTION_PROBE, CONFIG, make_env, trained


def test_evaluation_reports_every_episode():
    state, _ = trained(ACTION_PROBE)
    reward = ppo.as_float32(replace(ACTION_PROBE, length=3.0))
    outcomes = evaluate(CONFIG, make_env, reward, ppo.policy_params(state), jax.random.key(3), num_episodes=50)
    assert {name: array.shape for name, array in outcomes.items()} == dict.fromkeys(ppo.OUTCOMES, (50,))
    np.testing.assert_array_equal(outcomes["episode_length"], 3.0)
    np.testing.assert_array_equal(outcomes["success"], 1.0)
    # The policy is deterministic and x is constant, so each of the three steps errs by the same amount.
    np.testing.assert_allclose(outcomes["episode_return"], -3.0 * np.log(outcomes["score"]) ** 2, atol=1e-2)
