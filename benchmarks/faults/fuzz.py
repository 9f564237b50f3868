"""Imports of mutated sources: each ends with a demonstration file or with one sentence, soon, and in little memory."""

import contextlib
import faulthandler
import io
import json
import resource
import shutil
import sys
import tempfile
import time
import traceback
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.faults.mutations import mutate
from benchmarks.faults.sources import OPTIONS, WRITERS, images
from graphrl_jax import cli
from graphrl_jax.demonstrations import load

SLOW_S, HUNG_S = 10.0, 60.0
"""An import that takes so long counts as hung; one that takes longer than the second stops the benchmark."""
MOST_MIB = 1024


def fuzz(inputs: int, seed: int, formats: tuple[str, ...] = tuple(WRITERS), kept: Path | None = None) -> dict[str, Any]:
    """Imports `inputs` mutated sources of each of the formats in turn.

    Args:
      inputs: number of sources.
      seed: decides the mutations.
      formats: names of `sources.WRITERS`.
      kept: folder for sources that went wrong.

    Returns:
      Counts of outcomes per format; `wrong`, what went wrong, with the input's number; seconds of the slowest, and
      the process's peak memory in MiB.
    """
    outcomes: dict[str, Counter] = {name: Counter() for name in formats}
    wrong, slowest = [], 0.0
    with tempfile.TemporaryDirectory() as scratch:
        valid = _valid_sources(Path(scratch), formats)
        source, out = Path(scratch) / "source", Path(scratch) / "demos.npz"
        for number in range(inputs):
            name = formats[number % len(formats)]
            shutil.rmtree(source, ignore_errors=True)
            out.unlink(missing_ok=True)
            shutil.copytree(valid[name], source)
            done = mutate(source, np.random.default_rng([seed, number]))
            started = time.perf_counter()
            faulthandler.dump_traceback_later(HUNG_S, exit=True)
            outcome = imported(source, out, OPTIONS.get(name, []))
            faulthandler.cancel_dump_traceback_later()
            seconds = time.perf_counter() - started
            slowest = max(slowest, seconds)
            if seconds > SLOW_S:
                outcome = f"{seconds:.0f} s"
            expected = outcome in ("imported", "refused")
            outcomes[name][outcome if expected else "wrong"] += 1
            if not expected:
                wrong.append({"input": number, "format": name, "mutations": done, "outcome": outcome})
                if kept is not None:
                    shutil.copytree(source, kept / f"{name}_{number}", dirs_exist_ok=True)
    return {
        "inputs": inputs,
        "seed": seed,
        "outcomes": {name: dict(count) for name, count in outcomes.items()},
        "wrong": wrong,
        "slowest_s": round(slowest, 2),
        "peak_mib": round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024),
    }


def _valid_sources(folder: Path, formats: tuple[str, ...]) -> dict[str, Path]:
    """Writes one valid source per format, and checks that it is imported."""
    shown, made = images(), {}
    for name in formats:
        made[name] = folder / "valid" / name
        made[name].mkdir(parents=True)
        WRITERS[name](made[name], shown)
        out = folder / f"{name}.npz"
        outcome = imported(made[name], out, OPTIONS.get(name, []))
        if outcome != "imported":
            raise SystemExit(f"the source of format {name} is not even imported unchanged: {outcome}")
    return made


def imported(source: Path, out: Path, options: list[str]) -> str:
    """Outcome of one import: `imported`, `refused`, or what went wrong."""
    printed, said = io.StringIO(), io.StringIO()
    try:
        with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(said):
            cli.main(["import", str(source), *options, "--out", str(out)])
    except SystemExit as stop:
        errors = said.getvalue().count("error: ")
        if stop.code != 2 or errors != 1 or "Traceback" in said.getvalue():
            return f"exit {stop.code} with {errors} errors: {said.getvalue()[-300:]}"
        return "refused, but a file is left" if out.exists() else "refused"
    except BaseException:
        return traceback.format_exc(limit=-4)
    return _sound(out, printed.getvalue())


def _sound(out: Path, printed: str) -> str:
    """Whether an import that succeeds has written finite boxes inside the image, and one line of JSON."""
    try:
        json.loads(printed)
        demos = load(out)
    except ValueError as error:
        return f"imported, but {error}"
    boxes = demos.boxes[demos.mask]
    if not np.isfinite(boxes).all() or np.abs(boxes).max(initial=0.0) > 2 or not demos.mask.any():
        return "imported, but boxes are not sound"
    return "imported"


def main() -> None:
    """`python -m benchmarks.faults.fuzz INPUTS SEED KEPT`, in a process of its own, prints one JSON line."""
    inputs, seed, kept = sys.argv[1:]
    print(json.dumps(fuzz(int(inputs), int(seed), kept=Path(kept))))


if __name__ == "__main__":
    main()
