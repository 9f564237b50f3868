"""Table II: what its rows say."""

from benchmarks.table2 import compared
from benchmarks.tables.shoes_in_box import kinds_table_of, table_2_of

WHERE = {"device": "cpu", "commit": "abc", "command": "python"}


def encoder(row: str, seed: int, rho: float, auroc: float) -> dict:
    kinds = {"one_shoe": {"rho": rho + 0.1}}
    cut = {"rho": rho, "order_success": 0.9, "kinds": kinds}
    return {"reward": row, "seed": seed, "demonstrations": cut, "whole_episodes": {"auroc": auroc}}


def result() -> dict:
    encoders = [encoder("graph", seed, 0.8 + 0.01 * seed, 1.0) for seed in (0, 1)]
    encoders += [encoder("graph_no_activity", 0, 0.7, 0.9)]
    truth = {"demonstrations": {"kinds": {"one_shoe": {"rho": 0.5}}}}
    return {"rewards": encoders, "compared": compared(encoders), "missing": ["xirl_0"], "true_progress": truth, **WHERE}


def test_table_2_orders_rows_by_rho_and_says_how_ours_compares():
    lines = table_2_of(result()).splitlines()
    assert "no activity (alpha 1) | 0.700 | one seed | 0.00 (one seed) | 0.900 | one seed | 1.00 (one seed)" in lines[2]
    assert lines[3].startswith("| graph reward, w/o robot | 0.805 | 0.800 to 0.810 | - | 1.000 | 1.000 to 1.000 | - |")
    assert lines[-1].startswith("Interquartile means over seeds; missing encoders: 1")


def test_kinds_of_failures_have_a_column_per_reward():
    lines = kinds_table_of(result()).splitlines()
    assert lines[0].endswith("| graph reward, w/o robot | graph reward, w/o robot, no activity (alpha 1) |")
    assert lines[2] == "| one shoe | 0.905 | 0.800 |"
