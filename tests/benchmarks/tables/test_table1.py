"""The tables of Table I."""

from benchmarks.tables import table1

ABOUT = {"device": "cpu", "commit": "0123456789", "command": "python -m benchmarks.table1", "episodes": 256}


def row(rate: float, success: list[float], trained_at: str = "abcdefghij") -> dict:
    steps = [1_000_000 * (index + 1) for index in range(len(success))]
    curve = {"env_steps": steps, "seconds": [60.0 * (index + 1) for index in range(len(success))], "success": success}
    run = {"curve": curve, "pretrain_s": 30.0, "trained_at": trained_at}
    return {
        "success_rate": {"mean": rate, "interval_95": [rate - 0.1, rate]},
        "area": {"mean": 0.25, "interval_95": None},
        "runs": [run],
    }


def test_rows_stand_in_order_and_say_how_soon_they_learned():
    grounds = {"demo": {"graph_paper": row(0.5, [0.2, 0.3]), "graph": row(1.0, [0.2, 0.6])}}
    result = {"grounds": grounds, "missing": ["demo/env_0"], "improvement": {}, **ABOUT}
    lines = table1.policies_of(result).splitlines()
    assert lines[2] == (
        "| demo | graph reward, w/o robot | **100.0%** | 90.0% to 100.0% | 0.250 | one seed | 2.000; 2.500 "
        "| never; never | 1 |"
    )
    assert "graph reward, w/o robot, the paper's way | **50.0%**" in lines[3] and "| never; never |" in lines[3]
    assert "missing members: 1; policies of commit abcdefg (cpu, commit 0123456;" in lines[-1]
    assert table1.improvement_of(result) == ""


def test_policies_of_several_commits_are_told():
    grounds = {"demo": {"graph": row(1.0, [0.2]), "env": row(0.9, [0.2], "0000000fff")}}
    result = {"grounds": grounds, "missing": [], "improvement": {}, **ABOUT}
    assert "missing members: none; policies of commits 0000000, abcdefg" in table1.policies_of(result)


def test_the_comparison_names_grounds_and_interval():
    found = {"graphirl": {"probability": 0.75, "interval_95": [0.5, 1.0], "grounds": ["demo", "layout"]}}
    lines = table1.improvement_of({"improvement": found}).splitlines()
    assert lines[2] == "| GraphIRL, w/o robot | 0.75 | 0.50 to 1.00 | demo, layout |"
