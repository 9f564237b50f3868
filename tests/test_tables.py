"""Tables I and II, the tuning behind them and throughput: what they make of finished runs and programs."""

import json
import time

import jax.numpy as jnp
import numpy as np
import pytest

from benchmarks import alphas, scaling, sweeps, table1, table2, throughput, tuning
from graphrl_jax.compilation import CompileLog
from graphrl_jax.pretrain import PretrainConfig
from graphrl_jax.runs import Run, write_json


def test_the_setting_that_orders_most_pairs_is_chosen(tmp_path, monkeypatch):
    def member(rate: float, temperature: float, pairs: float) -> dict:
        swept = {"pretrain.learning_rate": rate, "pretrain.temperature": temperature}
        return {"swept": swept, "encoder": {"pair_accuracy": pairs, "kendall_tau": 1 - pairs}}

    members = [member(1e-3, 0.1, 0.7), member(3e-3, 1.0, 0.9), member(3e-3, 0.1, 0.8)]
    write_json(tmp_path / "sweep.json", {"members": members})
    write_json(tmp_path / "config.json", {"first_seed": 100})
    found = tuning.tuned(tmp_path)
    assert found["chosen"] == {"learning_rate": 3e-3, "temperature": 1.0} and len(found["tried"]) == 3
    monkeypatch.setattr(tuning, "RESULT", tmp_path / "tuning.json")
    assert tuning.chosen("xirl") == {}
    write_json(tmp_path / "tuning.json", {"rewards": {"xirl": found}})
    assert tuning.chosen("xirl") == found["chosen"] and tuning.chosen("env") == {}


def test_a_curve_counts_the_seconds_of_its_steps(tmp_path):
    lines = [{"stage": "ppo", "env_steps": 100, "steps_per_s": 50, "success": 0.1},
             {"stage": "ppo", "env_steps": 400, "steps_per_s": 100, "success": 0.6}]  # fmt: skip
    (tmp_path / "metrics.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
    found = table1.curve(Run(tmp_path))
    assert found == {"env_steps": [100, 400], "seconds": [2.0, 5.0], "success": [0.1, 0.6]}


def test_a_methods_row_is_the_mean_over_its_members():
    row = table1.together([{"success_rate": 1.0, "mean_score": 1.0}, {"success_rate": 0.5, "mean_score": 0.8}])
    assert row["success_rate"] == 0.75 and row["mean_score"] == pytest.approx(0.9)
    low, high = row["success_interval_95"]
    assert low < 0.5 and high == 1.0


def test_unknown_methods_and_batches_are_refused():
    with pytest.raises(ValueError, match="--methods 'bc'; allowed: graph, env, graphirl"):
        table1.Options(methods=("bc",))
    with pytest.raises(ValueError, match=r"num_envs is \(4, 0\); allowed: 1 or more"):
        throughput.Options(num_envs=(4, 0))


def test_rates_are_work_over_the_median_time():
    x = jnp.ones(64)
    found = throughput.measure({"physics": (jnp.sin, (x,)), "twice": (lambda x: jnp.cos(jnp.sin(x)), (x,))}, 10, 3)
    seconds = {name: float(np.median(times)) for name, times in found["seconds"].items()}
    assert all(len(times) == 3 for times in found["seconds"].values())
    assert found["steps_per_second"]["twice"] == pytest.approx(10 / seconds["twice"])
    assert found["of_physics"]["twice"] == pytest.approx(seconds["physics"] / seconds["twice"])
    assert found["of_physics"]["physics"] == 1.0


def test_pytorchs_steps_are_ours():
    pytest.importorskip("torch", exc_type=ImportError)
    from benchmarks import pytorch
    from graphrl_jax.task import make_task

    objects, config = make_task("match_regions").objects, PretrainConfig(batch_size=3, num_frames=6)
    batches = [scaling.made_up_batch(config, objects, seed) for seed in range(3)]
    losses = {name: [call(), call()] for name, call in pytorch.steps_of(objects, config, batches, seed=0).items()}
    assert losses["jax"][1] < losses["jax"][0]
    for found in losses.values():
        assert found == pytest.approx(losses["jax"], rel=1e-3)


def test_a_batch_of_made_up_graphs_has_the_shapes_of_a_training():
    objects, config = scaling.table_of(9), PretrainConfig(batch_size=3, num_frames=6)
    graph, mask, times = scaling.made_up_batch(config, objects, 0)
    assert graph.boxes.shape == (3, 6, 9, 4) and graph.classes.shape == (3, 6, 9, scaling.CLASSES)
    assert mask.shape == times.shape == (3, 6) and bool(mask.all()) and (jnp.diff(times, axis=1) >= 0).all()
    assert graph.classes.sum(-1).min() == 1 and graph.robot.sum(-1).max() == 1


class Curve:
    """Stands for a run with two log lines."""

    def __init__(self, values: list[float]) -> None:
        self.run = self
        self.values = values

    def records(self, stage: str) -> list[dict]:
        return [{"stage": stage, "loss": value} for value in self.values]


def test_a_sweep_is_compared_with_its_members_alone():
    trained = []

    def make_jobs(name: str) -> list[Curve]:
        return [Curve([4.0, 1.0]), Curve([2.0, 1.0 if name == "alone" else 1.2])]

    def train(jobs: list[Curve]) -> None:
        time.sleep(0.05)
        trained.append(len(jobs))

    found = sweeps.compared(make_jobs, train, CompileLog(), "pretrain")
    assert trained == [2, 1, 1] and found["members"] == 2
    assert found["of_separate_runs"] == pytest.approx(0.5, abs=0.1)
    assert found["largest_difference"] == pytest.approx(0.2 / 4) and found["compiling"]["alone"] == 0


def test_table_2_trains_what_it_names():
    settings = table2.settings_of("graph_no_edges", "smoke")
    assert settings.reward == "graph" and settings.ablations == ("edges",) and not settings.pretraining.encoder.edges
    assert (
        table2.settings_of("xirl", "default").reward == "xirl"
        and table2.settings_of("graph", "default").ablations == ()
    )
    with pytest.raises(ValueError, match="--methods 'env'; allowed: graph, graph_with_robot"):
        table2.Options(methods=("env",))


def test_a_sweep_over_alpha_is_collected_with_what_is_done(tmp_path):
    for alpha, seed, rate in ((16.0, 40, None), (2.0, 41, None), (2.0, 40, 0.5)):
        folder = tmp_path / f"alpha={alpha:g},seed={seed}"
        write_json(folder / "config.json", {"pretrain": {"alpha": alpha}, "seed": seed})
        write_json(folder / "encoder.json", {"pair_accuracy": 0.9})
        if rate is not None:
            write_json(folder / "summary.json", {"success_rate": rate})
            (folder / "metrics.jsonl").write_text('{"stage": "ppo", "env_steps": 9, "success": 0.3, "score": 1}\n')
    rows = alphas.members_of(tmp_path)
    assert [(row["swept"]["pretrain.alpha"], row["seed"]) for row in rows] == [(2.0, 40), (2.0, 41), (16.0, 40)]
    assert [row.get("success_rate") for row in rows] == [0.5, None, None]
    assert [row.get("training") for row in rows] == [{"env_steps": 9, "success": 0.3}, None, None]
