"""The table of scores: drawn recordings, and human ones that their reward model has not seen."""

import numpy as np

from benchmarks.tables.cells import Result, of_result, table, where

_ROWS = {
    "both": "drawn: both jobs done",
    "cup": "drawn: one job done",
    "nothing": "drawn: no job done",
    "whole": "human: whole",
    "half": "human: cut off at half",
}


def scores_of(result: Result) -> str:
    """A row per kind of recording: how far it gets, how well its order is told, and whether it looks like success."""
    groups: dict[str, list[Result]] = {name: [] for name in _ROWS}
    for one in result["desk"]["recordings"]:
        groups[one["recording"].partition("_")[0]].append(one)
    for one in result["human"]["demonstrations"]:
        for name in ("whole", "half"):
            groups[name].append(one[name])
    seconds, human = result["desk"]["seconds"], result["human"]
    below = (
        f"Drawn videos: ten demonstrations of ten seconds take {seconds['import']:.0f} s to import and "
        f"{seconds['pretrain']:.0f} s to learn from; {result['desk']['scored_seconds']:.0f} s of other videos take "
        f"{seconds['score']:.0f} s to score {where(result['desk'])}. Human demonstrations: {human['folds']} models, "
        f"each of the other folds {where(human)}."
    )
    columns = ["recordings", "number", "look like success", "final progress", "value order", "value order before rest"]
    return table(columns, [_row(_ROWS[name], rows) for name, rows in groups.items() if rows], below)


def _row(label: str, rows: list[Result]) -> list[str]:
    measures = ("final_progress", "value_order_correlation", "value_order_before_rest")
    means = [f"{np.mean([row[name] for row in rows]):.3f}" for name in measures]
    return [label, str(len(rows)), str(sum(row["looks_like_success"] for row in rows)), *means]


scores_table = of_result("scores")(scores_of)
