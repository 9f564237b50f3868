"""The tuning behind the tables."""

import pytest

from benchmarks import members, tuning
from graphrl_jax.storage import write_json


@pytest.mark.parametrize("table", ["table1", "table2"])
def test_the_setting_whose_audit_is_best_is_chosen(tmp_path, monkeypatch, table):
    def member(rate: float, temperature: float, pairs: float) -> dict:
        swept = {"pretrain.learning_rate": rate, "pretrain.temperature": temperature}
        return {"swept": swept, "encoder": {"pair_accuracy": pairs, "discrimination": {"rho": 1 - pairs}}}

    found = [member(1e-3, 0.1, 0.7), member(3e-3, 1.0, 0.9), member(3e-3, 0.1, 0.8)]
    write_json(tmp_path / "sweep.json", {"members": found})
    write_json(tmp_path / "config.json", {"request": {"first_seed": 100}})
    row = tuning.tuned(table, tmp_path)
    assert row["seed"] == 100
    assert row["chosen"] == {"learning_rate": 3e-3, "temperature": 1.0}
    least = -0.3 if table == "table2" else 0.7
    assert row["tried"][0] == {"learning_rate": 1e-3, "temperature": 0.1, "value": pytest.approx(least)}
    monkeypatch.setattr(tuning, "RESULT", tmp_path / "tuning.json")
    assert tuning.chosen(table, "xirl") == {}
    write_json(tmp_path / "tuning.json", {"tables": {table: {"xirl": row}}})
    assert tuning.chosen(table, "xirl") == row["chosen"] and tuning.chosen(table, "graph") == {}
    assert tuning.chosen({"table1": "table2", "table2": "table1"}[table], "xirl") == {}


def test_every_row_is_tried_with_its_own_floats_and_the_same_settings(tmp_path, monkeypatch):
    asked = []
    monkeypatch.setattr(members, "finish_sweep", asked.append)
    options = tuning.Options(sweeps=tmp_path, encoder_steps=300)
    rows = (("table1", "graph"), ("table1_layout", "xirl_paper"), ("table2", "graphirl"))
    for table, row in rows:
        assert tuning.swept(table, row, options) == tmp_path / table / row
    graph, paper, shoes = asked
    assert (graph.task, paper.task, shoes.task) == ("match_regions", "match_regions_layout", "shoes_in_box")
    assert (graph.reward, paper.reward, shoes.reward) == ("graph", "xirl", "graphirl")
    assert all(one.sweep == tuning.SWEPT and one.first_seed == tuning.SEED and one.encoders_only for one in asked)
    assert (graph.pretrain.steps, paper.pretrain.rearranged, paper.pretrain.even) == (300, 0.0, 0.0)
    with pytest.raises(ValueError, match="--rows 'env'; allowed: graph, graph_paper"):
        tuning.Options(rows=("env",))
    with pytest.raises(ValueError, match="--tables 'table3'; allowed: table1, table1_layout, table2"):
        tuning.Options(tables=("table3",))
