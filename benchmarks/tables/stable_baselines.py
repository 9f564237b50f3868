"""The table of Stable-Baselines3."""

from benchmarks.tables.cells import Result, mean, of_result, spread, table, where

MEASURES = {"success_rate": "success", "mean_score": "mean score", "mean_return": "learned reward per episode"}


def stable_baselines_of(result: Result) -> str:
    """What policies reach before and after training, means over seeds."""
    runs = result["runs"]
    rows = [
        [policy, *(spread([run[policy][measure] for run in runs]) for measure in MEASURES)]
        for policy in ("untrained", "trained")
    ]
    steps, minutes = runs[0]["env_steps"] / 1e6, mean([run["cpu_s"] for run in runs]) / 60
    seeds = "1 seed" if len(runs) == 1 else f"{len(runs)} seeds"
    below = (
        f"{seeds}, {result['episodes']} unseen episodes each. A training takes {steps:.1f} M control steps and "
        f"{minutes:.0f} minutes of one core. Stable-Baselines3 {result['stable_baselines3']} {where(result)}"
    )
    return table(["policy", *MEASURES.values()], rows, below)


stable_baselines_table = of_result("stable_baselines")(stable_baselines_of)
