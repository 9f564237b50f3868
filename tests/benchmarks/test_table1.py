"""Table I: what it makes of finished runs."""

import json

import pytest

from benchmarks import table1
from graphrl_jax.experiment.methods import METHODS
from graphrl_jax.experiment.run_directory import Run


def test_a_curve_counts_the_seconds_of_its_steps(tmp_path):
    lines = [{"stage": "ppo", "env_steps": 100, "steps_per_s": 50, "success": 0.1},
             {"stage": "ppo", "env_steps": 400, "steps_per_s": 100, "success": 0.6}]  # fmt: skip
    (tmp_path / "metrics.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
    found = table1.curve(Run(tmp_path))
    assert found == {"env_steps": [100, 400], "seconds": [2.0, 5.0], "success": [0.1, 0.6]}


def test_unknown_methods_are_refused():
    with pytest.raises(ValueError, match="--methods 'bc'; allowed: graph, env, graphirl"):
        table1.Options(methods=("bc",))
    assert set(table1.ORDER) == set(METHODS)
