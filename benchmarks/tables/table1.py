"""Table I: policies on every reward and ground, and how often ours learns faster than another."""

from collections.abc import Sequence

from benchmarks.rows import OURS, label_of
from benchmarks.tables.cells import (
    Result,
    commit_of,
    interval,
    minutes_until,
    missing,
    of_result,
    solved_in,
    spread_of_some,
    table,
    where,
)

_SOLVED = (0.5, 0.9)
"""Shares of training episodes; how soon they were reached is told."""


def policies_of(result: Result) -> str:
    """Every row's policies, by ground, best first."""
    columns = [
        "ground", "reward", "success", "95 % interval", "area under the curve", "95 % interval",
        *(f"{share:.0%} solved after (M steps; minutes)" for share in _SOLVED), "seeds",
    ]  # fmt: skip
    rows = []
    for ground, found in result["grounds"].items():
        for name, row in sorted(found.items(), key=lambda item: -item[1]["success_rate"]["mean"]):
            success, area = row["success_rate"], row["area"]
            runs = row["runs"]
            soon = [_steps_and_minutes([_solved_after(run, share) for run in runs]) for share in _SOLVED]
            rows.append(
                [ground, label_of(name), f"**{success['mean']:.1%}**", interval(success, "{:.1%}"),
                 f"{area['mean']:.3f}", interval(area, "{:.3f}"), *soon, str(len(runs))]
            )  # fmt: skip
    commits = {
        run["trained_at"] for found in result["grounds"].values() for row in found.values() for run in row["runs"]
    }
    below = (
        f"Interquartile means over seeds; {result['episodes']} unseen episodes each; {missing(result, 'members')}; "
        f"policies of {_commits(commits)} {where(result)}"
    )
    return table(columns, rows, below)


def improvement_of(result: Result) -> str:
    """How probably a run of ours has the larger area under the curve than one of another row."""
    rows = [
        [label_of(name), f"{found['probability']:.2f}", interval(found, "{:.2f}"), ", ".join(found["grounds"])]
        for name, found in result["improvement"].items()
    ]
    columns = [f"{label_of(OURS)}, against", "probability of improvement", "95 % interval", "grounds"]
    return table(columns, rows) if rows else ""


def _solved_after(run: Result, share: float) -> tuple[float | None, float | None]:
    """Million steps and minutes until so large a share of the training episodes was first solved; None if never."""
    chunk = solved_in(run, share)
    return (None, None) if chunk is None else (run["curve"]["env_steps"][chunk] / 1e6, minutes_until(run, chunk))


def _steps_and_minutes(runs: Sequence[tuple[float | None, float | None]]) -> str:
    return "; ".join(map(spread_of_some, zip(*runs, strict=True)))


def _commits(found: set[str | None]) -> str:
    names = sorted(commit_of(one) for one in found if one)
    return f"commit {names[0]}" if len(names) == 1 else f"commits {', '.join(names)}"


table_1 = of_result("table1")(policies_of)
improvement_table = of_result("table1")(improvement_of)
