"""Policies on Shoes in Box: what is trained, and the whole benchmark in miniature."""

import numpy as np
import pytest

from benchmarks import shoes_policies
from benchmarks.shoes_policies import Options, planned
from graphrl_jax.storage import read_json, write_json


def test_one_seed_of_every_reward_is_trained_in_turn(tmp_path):
    options = Options(methods=("graph", "graphirl"), runs=tmp_path)
    assert planned(options) == [("graph", 0), ("graphirl", 0), ("graph", 1), ("graph", 2)]
    assert planned(Options(methods=("env",), seeds=(5, 4))) == [("env", 5), ("env", 4)]
    there = {"graph": {"runs": [{"training_seed": 1}]}}
    missing = shoes_policies.missing_members(Options(methods=("env",), seeds=(5,), runs=tmp_path), there)
    assert "env_5" in missing and "graph_0" in missing and "graph_1" not in missing


def test_names_and_the_evaluations_seed_are_checked():
    with pytest.raises(ValueError, match="--methods 'xirl'; allowed: graph, env"):
        Options(methods=("xirl",))
    with pytest.raises(ValueError, match="--engines 'bullet'; allowed: mjx, mujoco"):
        Options(engines=("bullet",))
    with pytest.raises(ValueError, match="--evaluation-seed 2 is a training's"):
        Options(evaluation_seed=2)


def test_a_policy_is_judged_by_the_last_frames_of_its_episodes(monkeypatch):
    class Trained:
        settings = type("Settings", (), {"seed": 3})

        def _replace(self, task):
            return self

    events = np.array([[1, 1, 1], [1, 0, 1], [1, 0, 0], [0, 0, 0]], bool)
    outcomes = {"success": np.array([1, 0, 0, 0]), "score": np.array([1, 0.75, 0.25, 0]), "events": events}
    monkeypatch.setattr(shoes_policies, "load_run", lambda path: Trained())
    monkeypatch.setattr(shoes_policies, "unseen_episodes", lambda *arguments: outcomes)
    found = shoes_policies.evaluation(None, None, Options())
    assert found == {"training_seed": 3, "success_rate": 0.25, "mean_score": 0.5, "lid_open": 0.75, "one_shoe": 0.5}


def row(rates: dict[int, float], engine: str = "mujoco") -> dict:
    judged = [{"training_seed": seed, "success_rate": rate, "mean_score": rate} for seed, rate in rates.items()]
    curve = {"env_steps": [1, 2], "success": [0.0, 0.5]}
    return {
        "engines": {engine: {"runs": judged}},
        "runs": [{"training_seed": seed, "curve": curve, "engine": engine} for seed in rates],
    }


def test_members_of_an_earlier_result_file_are_kept_and_new_ones_count_first(tmp_path):
    path, options = tmp_path / "result.json", Options()
    new = {"graph": row({1: 0.5})}
    assert shoes_policies.with_earlier(new, path, options) == new
    earlier = {"graph": row({1: 0.25, 0: 1.0}), "env": row({2: 0.75}, "mjx")}
    old = earlier["graph"]["engines"]["mujoco"]["runs"]
    write_json(path, {"methods": earlier, "episodes": 256, "evaluation_seed": 7})
    joined = shoes_policies.with_earlier(new, path, options)
    assert [run["training_seed"] for run in joined["graph"]["runs"]] == [0, 1]
    assert joined["graph"]["engines"]["mujoco"]["success_rate"] == 0.75 and list(joined) == ["graph", "env"]
    assert list(joined["env"]["engines"]) == ["mjx"]
    lines = [{"env_steps": 1, "success": 0.0}, {"env_steps": 2, "success": 0.5}]
    assert shoes_policies.curves_of(joined) == {"graph_0": lines, "graph_1": lines, "env_2": lines}
    # An earlier evaluation of a policy that has been trained again is of another policy.
    earlier["graph"]["engines"]["mjx"] = {"runs": [{**run, "trained_at": "before"} for run in old]}
    write_json(path, {"methods": earlier, "episodes": 256, "evaluation_seed": 7})
    joined = shoes_policies.with_earlier(new, path, options)
    assert [run["training_seed"] for run in joined["graph"]["engines"]["mjx"]["runs"]] == [0]
    # Other episodes say something else.
    assert shoes_policies.with_earlier(new, path, Options(evaluation_seed=9)) == new


@pytest.mark.study
def test_the_whole_benchmark_in_miniature(tmp_path):
    options = Options(preset="smoke", methods=("env",), seeds=(0,), updates=1, runs=tmp_path)
    shoes_policies.write_report(options)
    report = read_json(tmp_path / "shoes_in_box_policies.json")
    (judged,), (run,) = report["methods"]["env"]["engines"]["mujoco"]["runs"], report["methods"]["env"]["runs"]
    assert 0 <= judged["success_rate"] <= judged["one_shoe"] <= 1 and judged["training_seed"] == 0
    assert run["engine"] == "mujoco" and run["env_steps"] == run["curve"]["env_steps"][-1] > 0
    assert "graph_0" in report["missing"] and "env_0" not in report["missing"]
    assert (tmp_path / "shoes_in_box_policies.png").exists()
    kept = (tmp_path / "env_0" / "evaluation_mujoco.json").stat().st_mtime_ns
    shoes_policies.write_report(Options(preset="smoke", methods=("env",), budget_minutes=0, runs=tmp_path))
    assert (tmp_path / "env_0" / "evaluation_mujoco.json").stat().st_mtime_ns == kept
