"""A sweep's members are what they would be alone, from one compiled program per run stage."""

import json

import numpy as np
import pytest

from graphrl_jax import cli
from graphrl_jax.experiment import batching
from graphrl_jax.experiment.methods import METHODS
from graphrl_jax.experiment.run_directory import Run, RunError
from graphrl_jax.experiment.settings import compose
from graphrl_jax.experiment.sweep import parse_values, plan, resume, start, start_members, sweepable
from graphrl_jax.registry import make_task
from tests.helpers.commands import TRAIN, call
from tests.helpers.compilations import count_compilations

pytestmark = pytest.mark.usefixtures("outside_package")
SWEEP = ["sweep", *TRAIN]


@pytest.mark.parametrize(
    "texts, reward, message",
    [
        (
            ["pretrain.alfa=1"],
            "graph",
            "no field 'pretrain.alfa' to sweep with reward graph; allowed: pretrain.learning",
        ),
        (["ppo.clip=0.1,big"], "graph", "'0.1,big' is no list of numbers"),
        (["pretrain.alpha=1,2", "pretrain.alpha=4"], "graph", "pretrain.alpha is given twice"),
        (["pretrain.alpha=1,2,1"], "graph", "a value is given twice"),
        (["pretrain.alpha=1,nan"], "graph", "'1,nan' is no list of numbers"),
        (["pretrain.alpha=1,2"], "env", "no field 'pretrain.alpha' to sweep with reward env"),
        (["ppo.num_envs=1,2"], "graph", "no field 'ppo.num_envs'"),
        (["ppo.clip"], "graph", "'' is no list of numbers"),
    ],
)
def test_bad_sweeps_are_one_sentence(texts, reward, message):
    with pytest.raises(ValueError, match=message):
        parse_values(texts, reward)


@pytest.mark.parametrize("reward", METHODS)
def test_every_float_that_changes_something_can_be_swept(reward):
    known = sweepable(reward)
    assert {f"pretrain.{name}" for name in METHODS[reward].floats} | {"ppo.clip", "ppo.decay_updates"} <= set(known)
    assert parse_values([f"{name}=0.25,0.5" for name in known], reward) == dict.fromkeys(known, (0.25, 0.5))


VALUES = {"pretrain.alpha": (1.0, 4.0), "ppo.clip": (0.1,)}


def test_members_are_every_combination_with_every_seed(tmp_path):
    carry, sizes = make_task("carry"), {"steps": 5}
    members = plan(tmp_path, carry, VALUES, (3, 4), sizes, {"num_envs": 8}, preset="smoke", updates=2)
    assert [member.run.path.name for member in members] == [
        "alpha=1,clip=0.1,seed=3", "alpha=1,clip=0.1,seed=4", "alpha=4,clip=0.1,seed=3", "alpha=4,clip=0.1,seed=4",
    ]  # fmt: skip
    assert members[2].swept == {"pretrain.alpha": 4.0, "ppo.clip": 0.1}
    alone = compose(
        carry, "graph", "smoke", 3, updates=2, pretrain={"alpha": 4.0, **sizes}, ppo={"num_envs": 8, "clip": 0.1}
    )
    assert members[2].settings == alone
    engines = {member.settings.engine for member in plan(tmp_path, carry, VALUES, (3,), {}, {}, engine="mjx")}
    assert (members[0].settings.engine, engines) == (None, {"mjx"})
    with pytest.raises(ValueError, match="a sweep has 0 seeds; allowed: 1 or more"):
        plan(tmp_path, carry, VALUES, (), {}, {})


def test_a_sweep_that_was_begun_comes_back_and_nothing_is_overwritten(tmp_path):
    out, request = tmp_path / "sweep", {"seeds": 1, "encoders_only": True}
    members = plan(out, make_task("carry"), VALUES, (0,), {}, {}, preset="smoke")
    start(out, members, request)
    assert all(Run(member.run.path).settings() == member.settings for member in members)
    found, asked = resume(out)
    assert asked == request
    assert [(member.run.path, member.settings, member.swept) for member in found] == [
        (member.run.path, member.settings, member.swept) for member in members
    ]
    with pytest.raises(RunError, match=f"--out {out} is not empty"):
        start(out, members, request)
    with pytest.raises(RunError, match="allowed: 'sweep'"):
        resume(members[0].run.path)


@pytest.mark.slow
def test_a_sweep_is_a_folder_of_runs(tmp_path, monkeypatch):
    compiled = count_compilations(monkeypatch)
    out = tmp_path / "sweep"
    values = ["--alphas", "1,4", "--sweep", "ppo.entropy_cost=0.01,0.02", "--seeds", "2"]
    call(cli.main, *SWEEP, *values, "--out", out)
    report = json.loads((out / "sweep.json").read_text())
    names = [row["member"] for row in report["members"]]
    assert {row["seed"] for row in report["members"]} == {0, 1}
    assert len(set(names)) == 8 and "alpha=4,entropy_cost=0.02,seed=1" in names
    # Four encoders, two alphas times two seeds, serve eight policies; each run stage is compiled once.
    assert compiled == [4, 8]
    encoders = {
        (row["swept"]["pretrain.alpha"], row["seed"]): row["encoder"]["pair_accuracy"] for row in report["members"]
    }
    assert len(encoders) == 4 and len(set(encoders.values())) > 1
    assert (out / "figures" / "sweep.png").stat().st_size > 5000

    # Alone, the same member starts the same; later on floats drift apart.
    member, alone = out / "alpha=4,entropy_cost=0.01,seed=1", tmp_path / "alone"
    call(cli.train_main, *SWEEP[1:], "--alpha", "4", "--seed", "1", "--stop-at", "0", "--out", alone)
    first = [json.loads((run / "metrics.jsonl").read_text().splitlines()[0]) for run in (member, alone)]
    assert first[0].keys() == first[1].keys()
    np.testing.assert_allclose(list(first[0].values())[2:], list(first[1].values())[2:], rtol=1e-3)
    assert Run(member).settings() == Run(alone).settings()
    assert (member / "demonstrations.npz").read_bytes() == (alone / "demonstrations.npz").read_bytes()
    outcome = call(cli.main, "evaluate", member, "--episodes", "4", "--video-episodes", "0")
    assert outcome["episodes"] == 4

    # Nothing is left to do: the sweep ends with the same numbers.
    kept = (member / "policy.npz").read_bytes()
    call(cli.main, *SWEEP, "--out", out, "--resume")
    again = json.loads((out / "sweep.json").read_text())
    assert again["members"] == report["members"] and (member / "policy.npz").read_bytes() == kept
    with pytest.raises(SystemExit):
        call(cli.main, *SWEEP, *values, "--out", out)
    # A member is finished; where it is not, it has nothing to go on from by itself. Either way it is left alone.
    finished = call(cli.train_main, "--resume", "--out", member)
    assert finished["mean_return"] == report["members"][names.index(member.name)]["mean_return"]
    (member / "summary.json").unlink()
    with pytest.raises(SystemExit):
        call(cli.train_main, "--resume", "--out", member)
    assert (member / "policy.npz").read_bytes() == kept


def test_a_sweep_in_groups_gives_the_same_numbers(tmp_path, monkeypatch):
    values = ["--alphas", "1,2,4", "--encoders-only"]
    call(cli.main, *SWEEP, *values, "--out", tmp_path / "whole")
    monkeypatch.setattr(batching, "fit", lambda compile_for, members, budget=None: (2, compile_for(2)))
    call(cli.main, *SWEEP, *values, "--out", tmp_path / "groups")
    for name in ("alpha=1,seed=0", "alpha=4,seed=0"):
        lines = [(tmp_path / way / name / "metrics.jsonl").read_text().splitlines() for way in ("whole", "groups")]
        assert len(lines[0]) == len(lines[1])
        first = [json.loads(way[0]) for way in lines]
        np.testing.assert_allclose(first[0]["loss"], first[1]["loss"], rtol=1e-3)
        assert not (tmp_path / "groups" / name / "policy.npz").exists()


def test_a_field_is_swept_or_set(tmp_path):
    with pytest.raises(ValueError, match="pretrain.alpha is swept, and also set to 7.0 for all members"):
        plan(tmp_path, make_task("carry"), {"pretrain.alpha": (1.0, 2.0)}, [0], {"alpha": 7.0}, {})


def test_a_member_whose_folder_was_left_empty_gets_its_settings(tmp_path):
    members = plan(tmp_path / "sweep", make_task("carry"), {"ppo.clip": (0.1, 0.2)}, [0], {}, {}, preset="smoke")
    start(tmp_path / "sweep", members, {})
    (members[1].run.path / "config.json").unlink()
    start_members(members)
    assert members[1].run.settings() == members[1].settings
