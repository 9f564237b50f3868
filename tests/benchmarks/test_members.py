"""Members of a table: trained within a budget, judged once."""

import json

import pytest

from benchmarks import members
from graphrl_jax.cli.requests import Sweep
from graphrl_jax.experiment.run_directory import Run
from graphrl_jax.experiment.settings import compose
from graphrl_jax.registry import make_task
from graphrl_jax.storage import write_json


def test_a_curve_counts_the_seconds_of_its_steps(tmp_path):
    lines = [{"stage": "ppo", "env_steps": 100, "steps_per_s": 50, "success": 0.1, "score": 0.2},
             {"stage": "ppo", "env_steps": 400, "steps_per_s": 100, "success": 0.6, "score": 0.7}]  # fmt: skip
    (tmp_path / "metrics.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
    found = members.curve(Run(tmp_path))
    assert found == {"env_steps": [100, 400], "seconds": [2.0, 5.0], "success": [0.1, 0.6]}
    assert members.curve(Run(tmp_path), ("success", "score"))["score"] == [0.2, 0.7]


def test_only_missing_members_are_trained_and_only_within_the_budget(tmp_path, monkeypatch):
    trained = []
    monkeypatch.setattr(members.train, "run", lambda request: trained.append(request.out))
    settings = compose(make_task("match_regions"), "env", "smoke")
    wanted = {tmp_path / name: settings for name in ("env_0", "env_1")}
    write_json(tmp_path / "env_0" / "summary.json", {})
    members.train_missing(wanted, "table1", budget_minutes=0)
    assert trained == []
    members.train_missing(wanted, "table1", budget_minutes=None)
    assert trained == [tmp_path / "env_1"]
    assert Run(tmp_path / "env_1").settings() == settings and (tmp_path / "env_1" / "trained_on.json").exists()
    assert members.finished_members(tmp_path, ("graph", "env")) == {"env": [tmp_path / "env_0"]}


def test_a_policy_is_judged_once_for_what_the_judgement_depends_on(tmp_path):
    (tmp_path / "policy.npz").write_bytes(b"")
    made = []

    def judge() -> dict:
        made.append(1)
        return {"success_rate": 0.5}

    for seed, number in ((7, 1), (7, 1), (8, 2)):
        kept = members.judged_once(tmp_path, "evaluation", {"seed": seed}, judge, "table1")
        assert kept["success_rate"] == 0.5 and kept["trained_at"] is None and len(made) == number


def test_the_area_under_a_curve_is_the_mean_success_of_the_steps():
    # 100 steps at 0.1, 300 steps at 0.6.
    assert members.area({"env_steps": [100, 400], "success": [0.1, 0.6]}) == pytest.approx((10 + 180) / 400)


def test_of_two_members_with_a_seed_the_first_counts():
    new, old = [{"training_seed": 2, "x": 1}], [{"training_seed": 2, "x": 0}, {"training_seed": 0, "x": 0}]
    assert members.one_per_seed([new, old]) == [old[1], new[0]]


def test_a_sweep_is_begun_gone_on_with_or_left_alone(tmp_path, monkeypatch):
    asked = []
    monkeypatch.setattr(members.sweep, "run", asked.append)
    wanted = Sweep(out=tmp_path, alphas="1,2", seeds=2)
    members.finish_sweep(wanted)
    write_json(tmp_path / "config.json", {})
    members.finish_sweep(wanted)
    write_json(tmp_path / "sweep.json", {})
    members.finish_sweep(wanted)
    assert asked == [wanted, Sweep(out=tmp_path, resume=True)]
