"""A sweep's members are what they would be alone, from one compiled program per stage."""

import json
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from probe_environments import Probe, ProbeReward
from synthetic import demonstrations
from test_commands import call

from graphrl_jax import cli, ppo, pretrain, sweep, training
from graphrl_jax.ppo_config import PPOConfig, PPOHyper
from graphrl_jax.pretrain import PretrainConfig, PretrainHyper
from graphrl_jax.sweep_command import Sweep, swept_values

pytestmark = pytest.mark.usefixtures("outside_package")
SWEEP = ["sweep", "--task", "carry", "--preset", "smoke"]


def assert_close(one, other, tolerance: float) -> None:
    pairs = zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=True)
    for a, b in pairs:
        if not jnp.issubdtype(a.dtype, jax.dtypes.prng_key):
            np.testing.assert_allclose(a, b, rtol=tolerance, atol=tolerance)


def test_encoders_side_by_side_are_those_trained_alone():
    config = PretrainConfig(steps=8, batch_size=4, num_frames=8)
    data = [pretrain.prepare(demonstrations(seed=seed)) for seed in (0, 1)]
    hypers = [ppo.as_float32(PretrainHyper(alpha=alpha, learning_rate=3e-4)) for alpha in (1.0, 8.0)]
    states = [pretrain.init(config, data[0].objects, jax.random.key(seed)) for seed in (3, 4)]
    together, metrics = sweep.pretrain_program(config, 3, 2)(*map(sweep.stack, (hypers, data, states)))
    for i, (member, curve) in enumerate(sweep.unstack((together, metrics), 2)):
        alone, alone_curve = sweep.pretrain_program(config, 3, 1)(hypers[i], data[i], states[i])
        assert_close(curve, alone_curve, 1e-4)
        # Adam makes a step of any gradient, however near to nothing, and its sign is then a matter of rounding.
        assert_close(member.params, alone.params, 1e-3)
    assert not np.allclose(metrics["loss"][0], metrics["loss"][1])


def test_policies_side_by_side_are_those_trained_alone():
    config = PPOConfig(num_envs=8, unroll_length=4, num_epochs=1, num_minibatches=2, episode_length=10)
    hypers = [ppo.as_float32(PPOHyper(learning_rate=rate)) for rate in (1e-3, 1e-2)]
    keys = [jax.random.key(seed) for seed in (0, 1)]
    rewards = [ppo.as_float32(ProbeReward(constant=value, length=4.0)) for value in (1.0, 2.0)]
    init, updates = sweep.policy_programs(config, Probe, 2)
    state = init(sweep.stack(rewards), sweep.stack(keys))
    together, metrics = updates(2)(sweep.stack(hypers), sweep.stack(rewards), state)
    init, updates = sweep.policy_programs(config, Probe, 1)
    for i, member in enumerate(sweep.unstack((together.params, metrics), 2)):
        alone, alone_metrics = updates(2)(hypers[i], rewards[i], init(rewards[i], keys[i]))
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

    assert sweep.fit(compile_for, 8, budget)[0] == size
    assert len(compiled) <= 3


def test_groups_are_of_one_size_and_hold_every_member():
    assert sweep.groups([0, 1, 2, 3, 4], 2) == [[0, 1], [2, 3], [4, 4]]
    assert sweep.groups([0, 1], 2) == [[0, 1]]
    assert sweep.stack([jnp.ones(2)]).shape == (2,) and sweep.stack([jnp.ones(2)] * 3).shape == (3, 2)


@pytest.mark.parametrize(
    "request_, message",
    [
        (
            Sweep(Path("x"), sweep=("pretrain.alfa=1",)),
            "no field 'pretrain.alfa' to sweep with reward graph; allowed: pretrain.learning",
        ),
        (Sweep(Path("x"), sweep=("ppo.clip=0.1,big",)), "'0.1,big' is no list of numbers"),
        (Sweep(Path("x"), alphas="1,2", sweep=("pretrain.alpha=4",)), "pretrain.alpha is given twice"),
        (Sweep(Path("x"), alphas="1,2,1"), "a value is given twice"),
        (Sweep(Path("x"), alphas="1,nan"), "'1,nan' is no list of numbers"),
        (Sweep(Path("x"), reward="env", alphas="1,2"), "no field 'pretrain.alpha' to sweep with reward env"),
        (Sweep(Path("x"), sweep=("ppo.decay_updates=1,2",)), "no field 'ppo.decay_updates'"),
    ],
)
def test_bad_sweeps_are_one_sentence(request_, message):
    with pytest.raises(ValueError, match=message):
        swept_values(request_)


def test_a_sweep_is_a_folder_of_runs(tmp_path, monkeypatch):
    compiled: list[int] = []
    fit = sweep.fit

    def counted(compile_for, members, budget=None):
        def compile_and_count(size):
            compiled.append(size)
            return compile_for(size)

        return fit(compile_and_count, members, budget)

    monkeypatch.setattr(training.sweep, "fit", counted)
    out = tmp_path / "sweep"
    values = ["--alphas", "1,4", "--sweep", "ppo.entropy_cost=0.01,0.02", "--seeds", "2"]
    call(cli.main, *SWEEP, *values, "--out", out)
    report = json.loads((out / "sweep.json").read_text())
    names = [row["member"] for row in report["members"]]
    assert {row["seed"] for row in report["members"]} == {0, 1}
    assert len(set(names)) == 8 and "alpha=4,entropy_cost=0.02,seed=1" in names
    # Four encoders, two alphas times two seeds, serve eight policies; each stage is compiled once.
    assert compiled == [4, 8]
    encoders = {
        (row["swept"]["pretrain.alpha"], row["seed"]): row["encoder"]["pair_accuracy"] for row in report["members"]
    }
    assert len(encoders) == 4 and len(set(encoders.values())) > 1
    assert (out / "figures" / "sweep.png").stat().st_size > 5000

    # Alone, the same member starts the same; later on floats drift apart.
    member, alone = out / "alpha=4,entropy_cost=0.01,seed=1", tmp_path / "alone"
    call(cli.train_main, *SWEEP[1:], "--alpha", "4", "--seed", "1", "--out", alone)
    first = [json.loads((run / "metrics.jsonl").read_text().splitlines()[0]) for run in (member, alone)]
    assert first[0].keys() == first[1].keys()
    np.testing.assert_allclose(list(first[0].values())[2:], list(first[1].values())[2:], rtol=1e-3)
    for name in ("config.json", "demonstrations.npz"):
        assert (member / name).read_bytes() == (alone / name).read_bytes()
    outcome = call(cli.main, "evaluate", member, "--episodes", "4", "--video-episodes", "0")
    assert outcome["episodes"] == 4

    # Nothing is left to do: the sweep ends with the same numbers.
    kept = (member / "policy.npz").read_bytes()
    call(cli.main, *SWEEP, "--out", out, "--resume")
    again = json.loads((out / "sweep.json").read_text())
    assert again["members"] == report["members"] and (member / "policy.npz").read_bytes() == kept
    with pytest.raises(SystemExit):
        call(cli.main, *SWEEP, *values, "--out", out)
    # A member has nothing to go on from by itself, and is left alone.
    with pytest.raises(SystemExit):
        call(cli.train_main, "--resume", "--out", member)
    assert (member / "policy.npz").read_bytes() == kept


def test_a_sweep_in_groups_gives_the_same_numbers(tmp_path, monkeypatch):
    values = ["--alphas", "1,2,4", "--encoders-only"]
    call(cli.main, *SWEEP, *values, "--out", tmp_path / "whole")
    monkeypatch.setattr(sweep, "fit", lambda compile_for, members, budget=None: (2, compile_for(2)))
    call(cli.main, *SWEEP, *values, "--out", tmp_path / "groups")
    for name in ("alpha=1,seed=0", "alpha=4,seed=0"):
        lines = [(tmp_path / way / name / "metrics.jsonl").read_text().splitlines() for way in ("whole", "groups")]
        assert len(lines[0]) == len(lines[1])
        first = [json.loads(way[0]) for way in lines]
        np.testing.assert_allclose(first[0]["loss"], first[1]["loss"], rtol=1e-3)
        assert not (tmp_path / "groups" / name / "policy.npz").exists()
