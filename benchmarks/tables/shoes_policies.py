"""The table of policies on Shoes in Box."""

from benchmarks.tables.cells import (
    Result,
    mean,
    minutes_until,
    of_result,
    percent_interval,
    solved_in,
    spread_of_some,
    table,
    where,
)
from graphrl_jax.experiment.methods import METHODS

SHARES = {"lid_open": "lid open", "one_shoe": "at least one shoe in the box"}
"""Shares of episodes that end so."""
SOLVED = (0.5, 0.9)
"""Shares of training episodes; how soon they were reached is told."""


def policies_of(result: Result) -> str:
    """Every reward's policies on unseen layouts, best first, a row per engine; what is missing stands below."""
    columns = [
        "reward", "engine of the episodes", "success: both shoes in the box", "95 % interval over seeds",
        *SHARES.values(), "mean score", "seeds",
        *(f"{share:.0%} of the training episodes solved after (minutes)" for share in SOLVED),
        "control steps of training (M)", "minutes of pretraining and PPO",
        "audit of the reward: successes above failures, undiscounted; discounted",
    ]  # fmt: skip
    rows = []
    for name, found in sorted(result["methods"].items(), key=_best_success, reverse=True):
        runs = found["runs"]
        steps = mean([run["env_steps"] / 1e6 for run in runs])
        minutes = mean([minutes_until(run, -1) for run in runs])
        soon = [spread_of_some([_solved_after(run, share) for run in runs]) for share in SOLVED]
        for engine, judged in found["engines"].items():
            shares = [f"{mean([one[share] for one in judged['runs']]):.1%}" for share in SHARES]
            interval = percent_interval(judged["success_interval_95"])
            rows.append(
                [METHODS[name].label, engine, f"**{judged['success_rate']:.1%}**", interval, *shares,
                 f"{judged['mean_score']:.3f}", str(len(runs)), *soon, f"{steps:.1f}", f"{minutes:.0f}", _audit(runs)]
            )  # fmt: skip
    missing = ", ".join(f"`{name}`" for name in result["missing"])
    lacks = f"; still missing: {missing}" if missing else ""
    return table(columns, rows, f"{result['episodes']} unseen layouts each{lacks} {where(result)}")


policies_table = of_result("shoes_in_box_policies")(policies_of)


def _audit(runs: list[Result]) -> str:
    """Shares of pairs of a success and a failure that the reward puts in order; rewards of earlier files lack them."""
    found = [run["successes_above"] for run in runs if run.get("successes_above")]
    sums = ("undiscounted", "discounted")
    return "; ".join(f"{mean([one[name] for one in found]):.3f}" for name in sums) if found else "-"


def _best_success(item: tuple[str, Result]) -> float:
    return max(judged["success_rate"] for judged in item[1]["engines"].values())


def _solved_after(run: Result, share: float) -> float | None:
    """Minutes until a share of the finished training episodes was solved first; None if never."""
    chunk = solved_in(run, share)
    return None if chunk is None else minutes_until(run, chunk)
