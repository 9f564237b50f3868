"""How long a first run takes."""

import pytest

from benchmarks import first_run
from benchmarks.tables.first_run import first_run_of
from graphrl_jax.storage import write_json


def test_every_run_has_a_cache_of_its_own_and_is_timed_as_a_whole(tmp_path, monkeypatch):
    caches = []

    def process(command, env, check):
        caches.append(env["JAX_COMPILATION_CACHE_DIR"])
        asked = ["--reward", "graph", "--seed", command[5], "--preset", "smoke"]
        assert command[1:-2] == ["train.py", *asked]
        summary = dict.fromkeys(first_run.KEPT, 1.0) | {"encoder": {"pretrain_s": 60.0}, "episodes": 256}
        write_json(tmp_path / f"graph_{command[5]}" / "summary.json", summary)

    monkeypatch.setattr(first_run.subprocess, "run", process)
    runs = [first_run.first_run("graph", seed, "smoke", tmp_path) for seed in (200, 201)]
    assert len(set(caches)) == 2 and [run["seed"] for run in runs] == [200, 201]
    assert 0 < runs[0]["seconds"] < 60 and runs[0]["pretrain_s"] == 60.0
    shown = first_run_of({"runs": runs, "device": "cpu", "commit": "abc", "command": "python"})
    assert "| graph reward, w/o robot | 200 | **100.0%** | 0.0 | 1.0 | 0.00 | 1 |" in shown
    with pytest.raises(ValueError, match="--rewards 'graphs'; allowed: graph, graph_with_robot"):
        first_run.Options(rewards=("graphs",))
