"""The table of first runs: minutes to a policy, and how good it is."""

from benchmarks.tables.cells import Result, of_result, table, where
from graphrl_jax.experiment.methods import METHODS


def first_run_of(result: Result) -> str:
    """A row per run."""
    columns = [
        "reward", "seed", "success", "minutes in all", "of them pretraining", "control steps (M)", "steps/s of PPO",
    ]  # fmt: skip
    rows = [
        [
            METHODS[run["reward"]].label, str(run["seed"]), f"**{run['success_rate']:.1%}**",
            f"{run['seconds'] / 60:.1f}", f"{run['pretrain_s'] / 60:.1f}" if "pretrain_s" in run else "-",
            f"{run['env_steps'] / 1e6:.2f}", f"{run['train_steps_per_s']:,.0f}",
        ]
        for run in result["runs"]
    ]  # fmt: skip
    return table(columns, rows, f"{result['runs'][0]['episodes']} unseen episodes each {where(result)}")


first_run_table = of_result("first_run")(first_run_of)
