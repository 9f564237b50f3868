"""The table of compilation: seconds by program, before and now."""

from benchmarks.tables.cells import Result, of_result, table, where


def compilation_of(result: Result) -> str:
    """A row per program, those that take longest first; below them the seconds of whole runs."""
    cold, warm = result["cold"], result["warm"]
    programs = dict.fromkeys(name for run in reversed(cold.values()) for name in run["programs"] if name != "others")
    rows = [[f"`{name}`", *_seconds(cold, name), *_seconds(warm, name)] for name in [*programs, "others"]]
    whole = ["the whole run", *(f"{run['wall_s']:.1f}" for runs in (cold, warm) for run in runs.values())]
    columns = ["compiled (s)", *(f"{cache}, {name}" for cache in ("cold", "warm") for name in cold)]
    return table(columns, [*rows, whole], where(result))


def _seconds(runs: Result, program: str) -> list[str]:
    return [f"{run['programs'][program]:.1f}" if program in run["programs"] else "-" for run in runs.values()]


compilation_table = of_result("compilation")(compilation_of)
