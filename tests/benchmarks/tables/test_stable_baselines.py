"""The table of Stable-Baselines3."""

from benchmarks.tables import stable_baselines


def test_policies_stand_before_and_after_training():
    def run(success: float) -> dict:
        untrained = {"success_rate": 0.0, "mean_score": 0.0, "mean_return": -110.0}
        trained = {"success_rate": success, "mean_score": success, "mean_return": -60.0}
        return {"untrained": untrained, "trained": trained, "env_steps": 2_500_000, "cpu_s": 420.0}

    about = {"device": "cpu", "commit": "0123456789", "command": "python -m benchmarks.stable_baselines"}
    result = {"runs": [run(0.5), run(1.0)], "episodes": 128, "stable_baselines3": "2.9", **about}
    lines = stable_baselines.stable_baselines_of(result).splitlines()
    assert lines[2] == "| untrained | 0.000 | 0.000 | -110.000 |"
    assert lines[3] == "| trained | 0.750 (0.50 to 1.00) | 0.750 (0.50 to 1.00) | -60.000 |"
    assert lines[-1].startswith("2 seeds, 128 unseen episodes each. A training takes 2.5 M control steps and 7 minutes")
