"""Training on the probe: one compiled program serves every test, as the probe's reward is an argument."""

from dataclasses import replace
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np

from graphrl_jax.experiment import batching
from graphrl_jax.rl import ppo
from graphrl_jax.rl.config import PPOConfig, PPOHyper
from graphrl_jax.rl.networks import make_networks
from graphrl_jax.rl.ppo import TrainState
from tests.helpers.probe_environments import Probe, ProbeReward

CONFIG = PPOConfig(
    num_envs=64,
    unroll_length=8,
    num_epochs=4,
    num_minibatches=4,
    episode_length=4,
    policy_hidden=(16,),
    value_hidden=(16,),
    normalise_reward=False,
)
HYPER = PPOHyper(
    learning_rate=2e-2,
    final_learning_rate=1e-3,
    decay_updates=60.0,
    discount=0.5,
    entropy_cost=0.005,
    max_grad_norm=10.0,
)
CHUNK = 20
BOTH_SIGNS = [[-1.0, 0.0], [1.0, 0.0]]
ACTION_PROBE = ProbeReward(action=1.0, shows_steps=0.0)
TRACES = []
"""One entry per time that a program with the probe in it was traced."""


def make_env(reward: ProbeReward) -> Probe:
    """The probe, counted in `TRACES`."""
    TRACES.append(reward)
    return Probe(reward)


def start(reward: ProbeReward, seed: int = 0) -> TrainState:
    """The state before the first update."""
    return ppo.init_jit(CONFIG, make_env, ppo.as_float32(reward), jax.random.key(seed))


def chunk(reward: ProbeReward, state: TrainState, hyper: PPOHyper = HYPER) -> tuple[TrainState, ppo.Metrics]:
    """`CHUNK` updates."""
    return ppo.train_chunk(CONFIG, make_env, hyper, ppo.as_float32(reward), state, CHUNK)


@cache
def trained(reward: ProbeReward) -> tuple[TrainState, ppo.Metrics]:
    """The state after three chunks, and the last one's metrics."""
    state, metrics = chunk(reward, start(reward))
    for _ in range(2):
        state, metrics = chunk(reward, state)
    return state, jax.tree.map(np.asarray, metrics)


def values(state: TrainState, observations: list) -> np.ndarray:
    """What the value network says of observations."""
    network = make_networks(CONFIG, 2, 1).value_network
    return np.asarray(network.apply(state.normalizer, state.params.value, jnp.array(observations, jnp.float32)))


def curves(members: int) -> dict[str, list]:
    """Metrics of two updates of so many members side by side, that differ in reward and learning rate."""
    numbers = [index + 1.0 for index in range(members)]
    rewards = [ppo.as_float32(ProbeReward(constant=number, action=1.0, length=4.0)) for number in numbers]
    hypers = [ppo.as_float32(replace(HYPER, learning_rate=1e-3 * number)) for number in numbers]
    keys = [jax.random.key(seed) for seed in range(members)]
    init, updates = batching.policy_programs(replace(CONFIG, num_epochs=1), Probe, members)
    state = init(batching.stack(rewards), batching.stack(keys))
    _, metrics = updates(2)(batching.stack(hypers), batching.stack(rewards), state)
    return {name: np.asarray(values).tolist() for name, values in metrics.items()}
