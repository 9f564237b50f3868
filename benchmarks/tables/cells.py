"""What tables are made of: result files, cells and lines."""

import functools
import json
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
RESULTS = ROOT / "benchmarks" / "results"
Result = dict[str, Any]


def result_of(name: str) -> Result | None:
    """A result file; None while there is none."""
    path = RESULTS / f"{name}.json"
    return json.loads(path.read_text()) if path.exists() else None


def of_result(name: str) -> Callable[[Callable[[Result], str]], Callable[[], str]]:
    """Makes a table's function read its result file; the table is empty while there is none."""

    def decorate(table_of: Callable[[Result], str]) -> Callable[[], str]:
        @functools.wraps(table_of)
        def read() -> str:
            result = result_of(name)
            return "" if result is None else table_of(result)

        return read

    return decorate


def table(columns: Sequence[str], rows: Iterable[Sequence[str]], below: str = "") -> str:
    """A markdown table, and a line below it."""
    lines = [_line(columns), "|---" * len(columns) + "|", *map(_line, rows)]
    return "\n".join([*lines, "", below] if below else lines)


def _line(cells: Sequence[str]) -> str:
    return "".join(f"| {cell} " if cell else "| " for cell in cells) + "|"


def mean(values: Sequence[float]) -> float:
    """The mean."""
    return sum(values) / len(values)


def spread(values: Sequence[float]) -> str:
    """Mean, and least and greatest over seeds where they differ."""
    low, high = f"{min(values):.2f}", f"{max(values):.2f}"
    return f"{mean(values):.3f}" + (f" ({low} to {high})" if low != high else "")


def spread_of_some(values: Sequence[float | None]) -> str:
    """As `spread`, over the seeds that have a value."""
    found = [value for value in values if value is not None]
    if not found:
        return "never"
    return spread(found) + ("" if len(found) == len(values) else f", {len(found)} of {len(values)} seeds")


def minutes_until(run: Result, chunk: int) -> float:
    """Minutes of pretraining, and of PPO up to the end of a chunk of updates."""
    return (run["curve"]["seconds"][chunk] + run.get("pretrain_s", 0.0)) / 60


def solved_in(run: Result, share: float) -> int | None:
    """The chunk of updates after which so large a share of the training episodes was first solved; None if never."""
    return next((chunk for chunk, success in enumerate(run["curve"]["success"]) if success >= share), None)


def percent_interval(bounds: Sequence[float] | None) -> str:
    """An interval over seeds."""
    return f"{bounds[0]:.1%} to {bounds[1]:.1%}" if bounds else "one seed"


def where(result: Result) -> str:
    """What a result was measured on, and how."""
    return f"({result['device']}, commit {commit(result)}; `{result['command']}`)"


def commit(result: Result) -> str:
    """The commit of a result, cut short."""
    return commit_of(result["commit"])


def commit_of(name: str) -> str:
    """A commit, cut short."""
    full, dirty, _ = name.partition("-dirty")
    return f"{full[:7]}{dirty}"


def interval(found: Result, shown: str) -> str:
    """The bounds of `interval_95`, each in the format `shown`."""
    bounds = found["interval_95"]
    return " to ".join(map(shown.format, bounds)) if bounds else "one seed"


def missing(result: Result, things: str) -> str:
    """How many of the `things` that a whole table has are missing."""
    return f"missing {things}: {len(result['missing']) or 'none'}"
