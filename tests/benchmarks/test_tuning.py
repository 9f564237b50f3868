"""The tuning behind the tables."""

import pytest

from benchmarks import members, tuning
from graphrl_jax.storage import write_json


def test_the_setting_that_orders_most_pairs_is_chosen(tmp_path, monkeypatch):
    def member(rate: float, temperature: float, pairs: float) -> dict:
        swept = {"pretrain.learning_rate": rate, "pretrain.temperature": temperature}
        return {"swept": swept, "encoder": {"pair_accuracy": pairs, "kendall_tau": 1 - pairs}}

    found = [member(1e-3, 0.1, 0.7), member(3e-3, 1.0, 0.9), member(3e-3, 0.1, 0.8)]
    write_json(tmp_path / "sweep.json", {"members": found})
    write_json(tmp_path / "config.json", {"request": {"first_seed": 100}})
    row = tuning.tuned(tmp_path)
    assert row["seed"] == 100
    assert row["chosen"] == {"learning_rate": 3e-3, "temperature": 1.0} and len(row["tried"]) == 3
    monkeypatch.setattr(tuning, "RESULT", tmp_path / "tuning.json")
    assert tuning.chosen("xirl") == {}
    write_json(tmp_path / "tuning.json", {"rewards": {"xirl": row}})
    assert tuning.chosen("xirl") == row["chosen"] and tuning.chosen("xirl_paper") == {}


def test_every_row_is_tried_with_its_own_floats_and_the_same_settings(tmp_path, monkeypatch):
    asked = []
    monkeypatch.setattr(members, "finish_sweep", asked.append)
    options = tuning.Options(rows=("graph", "xirl_paper"), sweeps=tmp_path, encoder_steps=300)
    for row in options.rows:
        assert tuning.swept(row, options) == tmp_path / row
    graph, xirl = asked
    assert (graph.reward, xirl.reward) == ("graph", "xirl") and graph.sweep == xirl.sweep == tuning.SWEPT
    assert graph.encoders_only and graph.first_seed == xirl.first_seed == tuning.SEED
    assert (graph.pretrain.steps, xirl.pretrain.rearranged, xirl.pretrain.even) == (300, 0.0, 0.0)
    with pytest.raises(ValueError, match="--rows 'env'; allowed: graph, graph_paper"):
        tuning.Options(rows=("env",))
