"""Members side by side are what they would be alone."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from graphrl_jax.encoder.config import EncoderConfig
from graphrl_jax.experiment import batching
from graphrl_jax.pretrain import trainer
from graphrl_jax.pretrain.config import PretrainConfig, PretrainHyper
from graphrl_jax.rl.config import PPOConfig, PPOHyper
from graphrl_jax.rl.ppo import as_float32
from graphrl_jax.storage import is_key
from tests.helpers.demonstrations import demonstrations
from tests.helpers.probe_environments import Probe, ProbeReward


def assert_close(one, other, tolerance: float) -> None:
    pairs = zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=True)
    for a, b in pairs:
        if not is_key(a):
            np.testing.assert_allclose(a, b, rtol=tolerance, atol=tolerance)


def test_encoders_side_by_side_are_those_trained_alone():
    sizes = EncoderConfig(num_layers=1, hidden=8, embedding=8)
    config = PretrainConfig(steps=8, batch_size=4, num_frames=8, encoder=sizes)
    data = [trainer.prepare(demonstrations(seed=seed)) for seed in (0, 1)]
    hypers = [as_float32(PretrainHyper(alpha=alpha, learning_rate=3e-4)) for alpha in (1.0, 8.0)]
    states = [trainer.init(config, data[0].objects, jax.random.key(seed)) for seed in (3, 4)]
    together, metrics = batching.pretrain_program(config, 3, 2)(*map(batching.stack, (hypers, data, states)))
    train = batching.pretrain_program(config, 3, 1)
    for i, (member, curve) in enumerate(batching.unstack((together, metrics), 2)):
        alone, alone_curve = train(hypers[i], data[i], states[i])
        assert_close(curve, alone_curve, 1e-4)
        # Adam makes a step of any gradient, however near to nothing, and its sign is then a matter of rounding.
        assert_close(member.params, alone.params, 1e-3)
    assert not np.allclose(metrics["loss"][0], metrics["loss"][1])


def test_policies_side_by_side_are_those_trained_alone():
    config = PPOConfig(num_envs=8, unroll_length=4, num_epochs=1, num_minibatches=2, episode_length=10)
    hypers = [as_float32(PPOHyper(learning_rate=rate)) for rate in (1e-3, 1e-2)]
    keys = [jax.random.key(seed) for seed in (0, 1)]
    rewards = [as_float32(ProbeReward(constant=value, length=4.0)) for value in (1.0, 2.0)]
    init, updates = batching.policy_programs(config, Probe, 2)
    state = init(batching.stack(rewards), batching.stack(keys))
    together, metrics = updates(2)(batching.stack(hypers), batching.stack(rewards), state)
    init, updates = batching.policy_programs(config, Probe, 1)
    update = updates(2)
    for i, member in enumerate(batching.unstack((together.params, metrics), 2)):
        alone, alone_metrics = update(hypers[i], rewards[i], init(rewards[i], keys[i]))
        assert_close(member, (alone.params, alone_metrics), 1e-4)
    np.testing.assert_allclose(metrics["reward"][:, 0], [1.0, 2.0])


class Program:
    """A compiled program that takes 100 bytes per member."""

    def __init__(self, members: int):
        self.temp_size_in_bytes, self.argument_size_in_bytes, self.output_size_in_bytes = 80 * members, 15 * members, 5

    def memory_analysis(self) -> "Program":
        return self


@pytest.mark.parametrize("budget, size", [(10_000, 8), (1000, 8), (500, 5), (250, 2), (1, 1)])
def test_groups_are_as_large_as_memory_allows(budget, size):
    compiled = []

    def compile_for(members: int) -> Program:
        compiled.append(members)
        return Program(members)

    assert batching.fit(compile_for, 8, budget)[0] == size
    assert len(compiled) <= 3


def test_groups_are_of_one_size_and_hold_every_member():
    assert batching.groups([0, 1, 2, 3, 4], 2) == [[0, 1], [2, 3], [4, 4]]
    assert batching.groups([0, 1], 2) == [[0, 1]]
    assert batching.stack([jnp.ones(2)]).shape == (2,) and batching.stack([jnp.ones(2)] * 3).shape == (3, 2)
