"""Table II: what it trains, and what it makes of it."""

import pytest

from benchmarks import table2, tuning
from graphrl_jax.experiment.settings import compose
from graphrl_jax.registry import make_task
from graphrl_jax.storage import write_json


def encoder(row: str, seed: int, rho: float, auroc: float = 1.0) -> dict:
    return {"reward": row, "seed": seed, "demonstrations": {"rho": rho}, "whole_episodes": {"auroc": auroc}}


def test_table_2_trains_what_it_names(tmp_path, monkeypatch):
    monkeypatch.setattr(tuning, "RESULT", tmp_path / "tuning.json")
    task = make_task("shoes_in_box")
    settings = table2.settings_of(task, "graph_no_edges", "smoke", 3)
    assert (settings.reward, settings.seed) == ("graph", 3) and table2.ROWS["graph_no_edges"] == ("graph", ("edges",))
    assert not settings.pretrain_config.encoder.edges
    assert table2.settings_of(task, "xirl", "default").reward == "xirl"
    assert table2.settings_of(task, "graph", "default") == compose(task, "graph", "cpu")
    # What is left out of ours has the floats that were chosen for ours.
    write_json(tmp_path / "tuning.json", {"tables": {"table2": {"graph": {"chosen": {"temperature": 0.5}}}}})
    assert table2.settings_of(task, "graph_no_edges", "default").pretrain.temperature == 0.5
    write_json(tmp_path / "tuning.json", {"tables": {"table1": {"xirl_paper": {"chosen": {"temperature": 0.2}}}}})
    assert table2.settings_of(task, "xirl", "default").pretrain.temperature == 0.2
    with pytest.raises(ValueError, match="--rows 'env'; allowed: graph, graphirl, graph_with_robot"):
        table2.Options(rows=("env",))


def test_rows_are_trained_in_turn_until_the_budget_is_spent(tmp_path, monkeypatch):
    begun = []

    def judged(task, row, seed, options):
        begun.append((row, seed))
        return encoder(row, seed, 0.8)

    monkeypatch.setattr(table2, "judged", judged)
    options = table2.Options(rows=("graph", "xirl"), seeds=(0, 1), out=tmp_path)
    table2.train_missing(None, options)
    assert begun == [("graph", 0), ("xirl", 0), ("graph", 1), ("xirl", 1)]
    begun.clear()
    table2.train_missing(None, table2.Options(budget_minutes=0, out=tmp_path))
    assert not begun
    # One encoder is in the folder, another only in an earlier result file.
    (tmp_path / "graph_0").mkdir()
    (tmp_path / "graph_0" / table2.MODEL).touch()
    earlier = [encoder("graph", 0, 0.1), encoder("graphirl", 4, 0.7)]
    found, missing = table2.finished(None, options, earlier)
    assert found == [encoder("graph", 0, 0.8), encoder("graphirl", 4, 0.7)]
    assert len(missing) == 9 * 5 + 3 - 2 and "graph_1" in missing and "xirl_3" not in missing


def test_a_small_rho_and_a_large_auroc_are_better():
    ours, theirs = (
        [encoder("graph", seed, 0.7) for seed in (0, 1)],
        [encoder("xirl", seed, 0.8, 0.9) for seed in (0, 1)],
    )
    found = table2.compared(ours + theirs)
    rho, auroc = found["rho, demonstrations"], found["auroc, whole_episodes"]
    assert rho["graph"]["mean"] == pytest.approx(0.7) and rho["graph"]["improvement"] is None
    assert rho["xirl"]["improvement"]["probability"] == auroc["xirl"]["improvement"]["probability"] == 1
    assert rho["xirl"]["mean"] == pytest.approx(0.8) and rho["xirl"]["interval_95"] == pytest.approx([0.8, 0.8])
    assert set(rho) == {"graph", "xirl"}
