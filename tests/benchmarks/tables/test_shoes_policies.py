"""The table of policies on Shoes in Box."""

from benchmarks.tables import shoes_policies

ABOUT = {"device": "cpu", "commit": "0123456789", "command": "python -m benchmarks.shoes_policies", "episodes": 256}


def row(rate: float) -> dict:
    judged = {"lid_open": 1.0, "one_shoe": 0.75}
    mujoco = {"success_rate": rate, "success_interval_95": None, "mean_score": 0.9, "runs": [judged]}
    return {
        "engines": {"mujoco": mujoco},
        "runs": [
            {"env_steps": 2_000_000, "pretrain_s": 60.0, "curve": {"seconds": [60.0, 120.0], "success": [0.5, 0.6]}}
        ],
    }


def test_rewards_stand_in_order_and_what_is_missing_is_named():
    result = {"methods": {"env": row(0.25), "graph": row(0.5)}, "missing": ["graph_1"], **ABOUT}
    lines = shoes_policies.policies_of(result).splitlines()
    assert lines[2] == (
        "| graph reward, w/o robot | mujoco | **50.0%** | one seed | 100.0% | 75.0% | 0.900 | 1 | 2.000 | never | 2.0 "
        "| 3 | - |"
    )
    assert "environmental" in lines[3] and "still missing: `graph_1` (cpu, commit 0123456;" in lines[-1]


def test_the_audit_of_learned_rewards_is_told():
    learned = row(0.5)
    learned["runs"][0]["successes_above"] = {"undiscounted": 1.0, "discounted": 0.75}
    lines = shoes_policies.policies_of({"methods": {"graph": learned}, "missing": [], **ABOUT}).splitlines()
    assert lines[2].endswith("| 3 | 1.000; 0.750 |")
