"""Smoke runs that faults interrupt: started, killed, resumed, and compared with one that nothing happened to."""

import json
import subprocess
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

COMMANDS: dict[str, tuple[str, ...]] = {
    "train": ("train", "--preset", "smoke"),
    "sweep": ("sweep", "--preset", "smoke", "--alphas", "1,4"),
}
"""By kind of run: the command without its folder."""
_OF_THE_CLOCK = {
    "wall_s",
    "compile_s",
    "compilation_cache",
    "resumed",
    "train_steps_per_s",
    "pretrain_s",
    "steps_per_s",
}


@dataclass(frozen=True)
class Ended:
    """How a process ended: exit code (None if it was killed), standard error, seconds."""

    code: int | None
    error: str
    seconds: float

    @property
    def in_one_sentence(self) -> bool:
        """Whether it ended by itself with exit code 2 and one sentence."""
        return self.code == 2 and self.error.count("error: ") == 1 and "Traceback" not in self.error


def begin(kind: str, out: Path) -> subprocess.Popen:
    """Starts a run in `out`, or resumes it."""
    command, *options = COMMANDS[kind]
    arguments = ["--resume"] if (out / "config.json").exists() else options
    program = [sys.executable, "-m", "graphrl_jax", command, *arguments, "--out", str(out)]
    return subprocess.Popen(program, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)


def end(process: subprocess.Popen, kill_after: float | None = None) -> Ended:
    """Waits until a run ends, or kills it after so many seconds."""
    started = time.perf_counter()
    try:
        _, error = process.communicate(timeout=kill_after)
        code: int | None = process.returncode
    except subprocess.TimeoutExpired:
        process.kill()
        _, error = process.communicate()
        code = None
    return Ended(code, error, time.perf_counter() - started)


def results(out: Path) -> dict[str, Any]:
    """The numbers of a finished run or sweep by folder, without those of the clock: summaries and logged lines."""
    found: dict[str, Any] = {}
    for path in sorted(out.rglob("summary.json")):
        run = path.parent
        found[f"{run.relative_to(out)}/summary"] = _timeless(json.loads(path.read_text()))
        lines = (run / "metrics.jsonl").read_text().splitlines()
        found[f"{run.relative_to(out)}/metrics"] = [_timeless(json.loads(line)) for line in lines]
    return found


def _timeless(values: Any) -> Any:
    if isinstance(values, Mapping):
        return {name: _timeless(value) for name, value in values.items() if name not in _OF_THE_CLOCK}
    return values


def difference(found: Any, expected: Any) -> float:
    """The largest difference between two results, relative to the larger number; infinite if their form differs."""
    if isinstance(expected, Mapping) and isinstance(found, Mapping) and found.keys() == expected.keys():
        return max((difference(found[name], expected[name]) for name in expected), default=0.0)
    if isinstance(expected, list) and isinstance(found, list) and len(found) == len(expected):
        return max((difference(*pair) for pair in zip(found, expected, strict=True)), default=0.0)
    if found == expected:
        return 0.0
    if isinstance(expected, float) and isinstance(found, float):
        return float(abs(found - expected) / np.maximum(abs(found), abs(expected)))
    return float("inf")
