"""Runs that are killed at random moments and resumed, until they finish with the numbers of an undisturbed run."""

from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.faults.runs import begin, difference, end, results


def kill(kind: str, folder: Path, kills: int, kills_per_run: int, draw: np.random.Generator) -> dict[str, Any]:
    """Kills runs of a kind `kills` times in all, each run up to `kills_per_run` times.

    Returns:
      Seconds of the undisturbed run, moments of the kills in seconds after (re)start, unexpected endings, and the
      largest relative difference between the results of an interrupted run and the undisturbed one.
    """
    undisturbed = end(begin(kind, folder / "undisturbed"))
    if undisturbed.code:
        raise SystemExit(f"the undisturbed {kind} ended with {undisturbed.code}: {undisturbed.error[-500:]}")
    expected = results(folder / "undisturbed")
    moments: list[float] = []
    unexpected, largest, number = [], 0.0, 0
    while len(moments) < kills:
        out, killed = folder / f"killed_{number}", 0
        while killed < kills_per_run and len(moments) < kills:
            moment = float(draw.uniform(0, undisturbed.seconds))
            ended = end(begin(kind, out), moment)
            if ended.code is not None:  # a resumed run has less to do
                unexpected += [ended.error[-500:]] if ended.code else []
                break
            moments.append(round(moment, 1))
            killed += 1
        last = end(begin(kind, out))
        unexpected += [last.error[-500:]] if last.code else []
        largest = max(largest, difference(results(out), expected))
        number += 1
    return {
        "undisturbed_s": round(undisturbed.seconds, 1),
        "moments_s": moments,
        "runs": number,
        "unexpected": unexpected,
        "largest_difference": largest,
    }
