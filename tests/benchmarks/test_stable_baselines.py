"""Stable-Baselines3 on Match Regions, in the smallest size."""

import importlib
import sys

import pytest

from graphrl_jax.storage import read_json


def test_it_trains_and_tells_what_policies_reach_before_and_after(tmp_path, monkeypatch):
    pytest.importorskip("stable_baselines3", exc_type=ImportError)
    benchmark = importlib.import_module("benchmarks.stable_baselines")
    out = tmp_path / "found.json"
    asked = "--seeds 3 --steps 480 --num-envs 2 --minibatches 2 --epochs 1 --episodes 4 --out".split()
    monkeypatch.setattr(sys, "argv", ["stable_baselines", *asked, str(out)])
    benchmark.main()
    found = read_json(out)
    (run,) = found["runs"]
    assert run["seed"] == 3 and run["env_steps"] == 480 and run["cpu_s"] > 0
    for policy in ("untrained", "trained"):
        assert 0 <= run[policy]["success_rate"] <= run[policy]["mean_score"] <= 1
        assert -240 <= run[policy]["mean_return"] < 0
    assert run["trained"]["mean_return"] != run["untrained"]["mean_return"]
    earlier = benchmark.earlier_runs(benchmark.Options(seeds=(4,), out=out), found["settings"])
    assert earlier == [run] and not benchmark.earlier_runs(benchmark.Options(seeds=(3,), out=out), found["settings"])
    assert not benchmark.earlier_runs(benchmark.Options(seeds=(4,), out=out), {**found["settings"], "steps": 7})
    assert found["settings"]["num_envs"] == 2 and found["stable_baselines3"] and found["command"]
