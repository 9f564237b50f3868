"""The training loop on probes with known answers."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from brax.training.acme import running_statistics
from brax.training.acme.specs import Array as ArraySpec

from graphrl_jax.encoder import encoder
from graphrl_jax.encoder.config import EncoderConfig
from graphrl_jax.encoder.pooling import PoolingParams
from graphrl_jax.reward.model import RewardModel
from graphrl_jax.rl import ppo
from graphrl_jax.rl.config import PPOHyper
from graphrl_jax.rl.networks import make_inference
from graphrl_jax.rl.ppo import TrainState
from graphrl_jax.rl.wrappers import GraphReward
from graphrl_jax.runtime import jit_physics
from graphrl_jax.storage import is_key
from tests.helpers.probe_environments import ProbeReward, SlidingBoxes
from tests.helpers.probe_training import (
    ACTION_PROBE,
    BOTH_SIGNS,
    CHUNK,
    CONFIG,
    HYPER,
    TRACES,
    chunk,
    make_env,
    start,
    trained,
    values,
)

EVERY_STEP = [[1.0, steps / 4] for steps in range(4)]


@pytest.mark.parametrize(
    "reward, observations, expected",
    [
        pytest.param(ProbeReward(constant=1.0), BOTH_SIGNS, [1.0, 1.0], id="constant"),
        pytest.param(ProbeReward(observation=1.0), BOTH_SIGNS, [-1.0, 1.0], id="observation"),
        pytest.param(ProbeReward(last=1.0, length=2.0), EVERY_STEP[:2], [0.5, 1.0], id="discounting"),
        pytest.param(
            ProbeReward(constant=1.0, length=4.0), EVERY_STEP, [1.875, 1.75, 1.5, 1.0], id="termination ends the return"
        ),
        # The truncated step itself teaches nothing, so a value that depends on the step count would be undetermined.
        pytest.param(
            ProbeReward(constant=1.0, length=4.0, terminates=0.0, shows_steps=0.0),
            BOTH_SIGNS,
            [2.0, 2.0],
            id="truncation does not",
        ),
    ],
)
def test_value_function_converges_to_the_known_return(reward, observations, expected):
    state, metrics = trained(reward)
    np.testing.assert_allclose(values(state, observations), expected, atol=0.06)
    assert np.isfinite(list(metrics.values())).all()


def test_policy_learns_the_rewarded_action():
    state, metrics = trained(ACTION_PROBE)
    act = make_inference(CONFIG, 2, 1)
    actions = act(ppo.policy_params(state), jnp.array(BOTH_SIGNS), jax.random.key(0))
    # The policy's deviation has shrunk to nothing by then, and with it what could still mend an error.
    np.testing.assert_allclose(actions[:, 0], [-0.5, 0.5], atol=0.2)
    # Every episode of this probe is one step long, and every environment finishes one at every step.
    np.testing.assert_array_equal(metrics["episodes"], CONFIG.steps_per_update)
    np.testing.assert_allclose(metrics["episode_return"], metrics["reward"], rtol=1e-4)


def test_another_reward_seed_or_hyperparameter_compiles_nothing():
    trained(ACTION_PROBE)
    before = len(TRACES)
    reward = ProbeReward(constant=0.3, action=0.1, length=2.0)
    state, _ = chunk(reward, start(reward, seed=7), replace(HYPER, learning_rate=jnp.float32(1e-3), discount=0.9))
    chunk(reward, state, PPOHyper())
    assert len(TRACES) == before


def test_another_alpha_encoder_seed_or_learning_rate_compiles_nothing_for_a_learned_reward():
    traces = []

    def paid_by(model: RewardModel) -> GraphReward:
        traces.append(None)
        return GraphReward(SlidingBoxes(), model)

    def trained_on(alpha: float, seed: int, learning_rate: float) -> ppo.Metrics:
        sizes = EncoderConfig(num_layers=1, hidden=4, embedding=3)
        params = encoder.init(jax.random.key(seed), sizes, SlidingBoxes.objects)
        pooling = PoolingParams(alpha=alpha, suppress_robot=1.0, robot_messages=0.0, tau=0.1)
        model = ppo.as_float32(RewardModel(params, jnp.zeros(3), 1.0, 1.0, pooling, None))
        state = ppo.init_jit(config, paid_by, model, jax.random.key(seed))
        return ppo.train_chunk(config, paid_by, PPOHyper(learning_rate=learning_rate), model, state, 1)[1]

    config = replace(CONFIG, num_envs=4, unroll_length=2, num_epochs=1, num_minibatches=1)
    first, count = trained_on(1.0, 0, 1e-3), len(traces)
    second = trained_on(8.0, 1, 3e-3)
    assert len(traces) == count > 0
    assert not np.allclose(first["learned_reward"], second["learned_reward"])


def test_a_saved_state_resumes_bitwise(tmp_path):
    straight, _ = chunk(ACTION_PROBE, start(ACTION_PROBE))
    first_half = tmp_path / "state.npz"
    leaves, structure = jax.tree.flatten(straight)
    keys = [is_key(leaf) for leaf in leaves]
    arrays = [jax.random.key_data(leaf) if key else leaf for leaf, key in zip(leaves, keys, strict=True)]
    np.savez(first_half, *arrays)
    before = len(TRACES)
    straight, _ = chunk(ACTION_PROBE, straight)

    with np.load(first_half) as saved:
        loaded = [jnp.asarray(saved[name]) for name in saved.files]
    loaded = [jax.random.wrap_key_data(leaf) if key else leaf for leaf, key in zip(loaded, keys, strict=True)]
    resumed, _ = chunk(ACTION_PROBE, jax.tree.unflatten(structure, loaded))
    assert len(TRACES) == before
    for a, b in zip(jax.tree.leaves(straight), jax.tree.leaves(resumed), strict=True):
        if is_key(a):
            a, b = jax.random.key_data(a), jax.random.key_data(b)
        np.testing.assert_array_equal(a, b)


def test_seeds_rewards_and_hyperparameters_can_be_vmapped():
    rewards = [ProbeReward(constant=0.5, action=weight) for weight in (0.0, 1.0)]
    hypers = [replace(HYPER, learning_rate=rate) for rate in (1e-2, 1e-3)]

    def stack(trees: list) -> object:
        return jax.tree.map(lambda *leaves: jnp.stack(leaves), *trees)

    @jit_physics
    @jax.vmap
    def run(hyper: PPOHyper, reward: ProbeReward, state: TrainState) -> tuple[TrainState, ppo.Metrics]:
        return jax.lax.scan(lambda s, _: ppo.update(CONFIG, make_env, hyper, reward, s), state, length=CHUNK)

    states = [start(reward, seed) for seed, reward in enumerate(rewards)]
    together, metrics = run(
        stack(list(map(ppo.as_float32, hypers))), stack(list(map(ppo.as_float32, rewards))), stack(states)
    )
    for index, (reward, hyper, state) in enumerate(zip(rewards, hypers, states, strict=True)):
        alone, metrics_alone = chunk(reward, state, hyper)
        # The first update differs by rounding only; later ones let the difference grow.
        for name, value in metrics_alone.items():
            np.testing.assert_allclose(metrics[name][index, 0], value[0], rtol=1e-3, atol=1e-5, err_msg=name)
        assert jnp.abs(metrics["reward"][index] - metrics_alone["reward"]).max() < 0.1
        one_of_them = jax.tree.map(lambda leaf, i=index: leaf[i], together)
        np.testing.assert_allclose(values(one_of_them, BOTH_SIGNS), values(alone, BOTH_SIGNS), atol=0.05)


def test_average_metrics_weighs_outcomes_by_episodes():
    metrics = {
        "episodes": np.array([1.0, 0.0, 3.0]),
        "success": np.array([1.0, np.nan, 0.0]),
        "reward": np.array([1.0, 2.0, 6.0]),
    }
    averaged = ppo.average_metrics(metrics)
    assert averaged == {"episodes": 4.0, "success": 0.25, "reward": 3.0}


def test_return_deviation_is_that_of_discounted_returns():
    statistics = running_statistics.init_state(ArraySpec((), jnp.float32))
    rewards = np.array([[1.0], [2.0], [4.0], [1.0]], np.float32)
    goes_on = np.array([[1.0], [0.0], [1.0], [1.0]], np.float32)
    statistics, carried = jax.jit(ppo.update_return_statistics)(statistics, jnp.zeros(1), rewards, goes_on, 0.5)
    by_hand = [1.0, 2.0 + 0.5, 4.0, 1.0 + 0.5 * 4.0]
    np.testing.assert_allclose(statistics.std, np.std(by_hand), rtol=1e-6)
    np.testing.assert_allclose(carried, [3.0])
