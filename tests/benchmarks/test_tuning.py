"""The tuning behind the tables."""

from benchmarks import tuning
from graphrl_jax.storage import write_json


def test_the_setting_that_orders_most_pairs_is_chosen(tmp_path, monkeypatch):
    def member(rate: float, temperature: float, pairs: float) -> dict:
        swept = {"pretrain.learning_rate": rate, "pretrain.temperature": temperature}
        return {"swept": swept, "encoder": {"pair_accuracy": pairs, "kendall_tau": 1 - pairs}}

    members = [member(1e-3, 0.1, 0.7), member(3e-3, 1.0, 0.9), member(3e-3, 0.1, 0.8)]
    write_json(tmp_path / "sweep.json", {"members": members})
    write_json(tmp_path / "config.json", {"request": {"first_seed": 100}})
    found = tuning.tuned(tmp_path)
    assert found["seed"] == 100
    assert found["chosen"] == {"learning_rate": 3e-3, "temperature": 1.0} and len(found["tried"]) == 3
    monkeypatch.setattr(tuning, "RESULT", tmp_path / "tuning.json")
    assert tuning.chosen("xirl") == {}
    write_json(tmp_path / "tuning.json", {"rewards": {"xirl": found}})
    assert tuning.chosen("xirl") == found["chosen"] and tuning.chosen("env") == {}
