"""Table I: what it is made of."""

from dataclasses import replace

import pytest

from benchmarks import rows, table1
from benchmarks.rows import ROWS
from graphrl_jax.experiment.methods import METHODS
from graphrl_jax.experiment.settings import compose
from graphrl_jax.registry import make_task
from graphrl_jax.storage import write_json

TASK = make_task("match_regions")


def run(seed: int, rate: float, area: float) -> dict:
    curve = {"env_steps": [10, 20], "seconds": [1.0, 2.0], "success": [0.0, rate]}
    return {"training_seed": seed, "success_rate": rate, "area": area, "curve": curve}


def test_every_reward_has_a_row_and_every_learned_one_a_second_in_the_papers_way():
    assert {row.method for row in ROWS.values()} == set(METHODS)
    for name, row in ROWS.items():
        settings = compose(TASK, row.method, pretrain=row.floats)
        paper = name not in METHODS
        assert (settings.pretrain.rearranged, settings.pretrain.exponent) == ((0, 1) if paper else (1, 0.25))
        assert ("the paper's way" in rows.label_of(name)) == paper
        assert row.learned == (name != "env") and (not paper or name == f"{row.method}_paper")


@pytest.mark.parametrize(
    "options, message",
    [
        ({"rows": ("bc",)}, "--rows 'bc'; allowed: env, graph, graph_paper, graphirl"),
        ({"grounds": ("kitchen",)}, "--grounds 'kitchen'; allowed: demo, layout"),
        ({"evaluation_seed": 12}, "--evaluation-seed 12 is a training's; allowed: another seed"),
    ],
)
def test_what_the_table_does_not_have_is_refused(options, message):
    with pytest.raises(ValueError, match=message):
        table1.Options(**options)


def test_members_take_turns_by_seed():
    options = table1.Options(rows=("env", "xirl"), grounds=("demo",))
    assert table1.planned(options)[:3] == [("demo", "env", 10), ("demo", "xirl", 10), ("demo", "env", 11)]
    assert len(table1.planned(options)) == 5 + 3
    assert table1.planned(table1.Options(rows=("env",), seeds=(8,))) == [("demo", "env", 8), ("layout", "env", 8)]


@pytest.mark.parametrize("asked, updates", [({}, [400, 600]), ({"preset": "smoke"}, [4, 4]), ({"updates": 3}, [3, 3])])
def test_policies_have_fewer_updates_on_layout(monkeypatch, tmp_path, asked, updates):
    found = {}
    monkeypatch.setattr(table1.members, "train_missing", lambda wanted, *_: found.update(wanted))
    table1.train_missing(table1.Options(rows=("env",), seeds=(10,), runs=tmp_path, **asked))
    assert [settings.updates for settings in found.values()] == updates
    assert [settings.task for settings in found.values()] == ["match_regions", "match_regions_layout"]


def test_learned_rows_have_to_be_tuned_on_their_ground(monkeypatch, tmp_path):
    monkeypatch.setattr(table1, "chosen", lambda table, row: {} if table == "table1_layout" else {"temperature": 1.0})
    found = {}
    monkeypatch.setattr(table1.members, "train_missing", lambda wanted, *_: found.update(wanted))
    asked = table1.Options(rows=("graph",), seeds=(10,), runs=tmp_path, grounds=("demo",))
    table1.train_missing(asked)
    assert [settings.pretrain.temperature for settings in found.values()] == [1.0]
    with pytest.raises(ValueError, match="row graph is not tuned on layout; run first: .* table1_layout --rows graph"):
        table1.train_missing(replace(asked, grounds=("layout",)))


def test_earlier_members_count_if_their_episodes_are_the_same(tmp_path):
    options, path = table1.Options(), tmp_path / "table1.json"
    new = {"demo": {"graph": [run(11, 0.5, 0.2)]}}
    assert table1.with_earlier(new, path, options) == new
    kept = {
        "layout": {"env": {"runs": [run(10, 0.7, 0.3)]}},
        "demo": {"graph": {"runs": [run(10, 1.0, 0.4), run(11, 0, 0)]}},
    }
    write_json(path, {"grounds": kept, "episodes": 256, "seed": 7})
    joined = table1.with_earlier(new, path, options)
    assert [one["success_rate"] for one in joined["demo"]["graph"]] == [1.0, 0.5]
    assert joined["layout"]["env"] == kept["layout"]["env"]["runs"]
    missing = table1.missing_members(joined)
    assert "demo/graph_11" not in missing and "demo/graph_12" in missing and "layout/env_10" not in missing
    assert len(missing) == 2 * (9 * 5 + 2 * 3) - 3
    write_json(path, {"grounds": kept, "episodes": 128, "seed": 7})
    assert table1.with_earlier(new, path, options) == new


def test_ours_is_compared_on_the_grounds_that_both_have():
    runs = {
        "demo": {"graph": [run(0, 1.0, 0.4), run(1, 0.9, 0.3)], "env": [run(0, 0.8, 0.35), run(1, 0.8, 0.5)]},
        "layout": {"env": [run(0, 0.8, 0.35)]},
    }
    found = table1.summarised(runs)
    assert set(found["improvement"]) == {"env"}
    env = found["improvement"]["env"]
    assert env["probability"] == 0.25 and env["grounds"] == ["demo"]
    graph = found["grounds"]["demo"]["graph"]
    assert graph["success_rate"]["mean"] == pytest.approx(0.95) and graph["runs"] == runs["demo"]["graph"]
    assert found["grounds"]["layout"]["env"]["area"] == {"mean": 0.35, "interval_95": None}


def test_the_figure_has_a_row_of_panels_per_ground(tmp_path):
    runs = {"demo": {"graph": [run(0, 1.0, 0.4), run(1, 0.9, 0.3)], "graph_paper": [run(0, 0.0, 0.0)]}}
    table1.table1_figure(runs, tmp_path / "figure.png")
    assert (tmp_path / "figure.png").stat().st_size > 5000
