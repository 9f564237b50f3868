"""Faults on purpose, and what comes of them. One command:

    python -m benchmarks.faults [--parts kills disks fuzz physics] [--kills 20] [--inputs 10000] [--steps 1e8]

    kills     smoke runs of `train` and `sweep` are killed at random moments and resumed; the results have to be those
              of a run that nothing happened to
    disks     the same on a disk that gets full, or read-only (needs the right to mount)
    fuzz      `graphrl import` reads mutated sources of every format: a file or one sentence, within 10 s and 1 GiB
    physics   random actions on every task and variant; how often the guard against non-finite states steps in

Writes `benchmarks/results/faults.json`; a part that is not asked for keeps what the file has. `physics` goes on from
the steps that the file counts already.
"""

import json
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tyro

from benchmarks.checks import refuse_below, refuse_unknown
from benchmarks.context import RESULTS, measured_on
from benchmarks.faults import disks
from benchmarks.faults.kills import kill
from benchmarks.faults.physics import random_steps
from benchmarks.faults.runs import COMMANDS, begin, end
from graphrl_jax.registry import task_names
from graphrl_jax.runtime import configure
from graphrl_jax.storage import read_json, write_json

SHARES = (0.05, 0.3, 0.6, 0.9)
"""Sizes of the disks that get full, as shares of a finished run's folder."""
LOCKS = 3


@dataclass(frozen=True)
class Options:
    """Faults on purpose.

    Attributes:
      parts: what to try.
      kills: kills in all, half of them in runs of each kind.
      kills_per_run: kills of a run before it is left alone.
      inputs: mutated sources.
      batch: mutated sources per process.
      steps: physics steps in all, shared out among tasks and variants.
      seed: source of all randomness.
      out: result file.
      kept: folder for mutated sources that went wrong.
    """

    parts: tuple[str, ...] = ("kills", "disks", "fuzz", "physics")
    kills: int = 20
    kills_per_run: int = 4
    inputs: int = 10_000
    batch: int = 2_000
    steps: float = 1e8
    seed: int = 0
    out: Path = RESULTS / "faults.json"
    kept: Path = Path("runs/faults")

    def __post_init__(self) -> None:
        refuse_unknown("--parts", self.parts, PARTS)
        refuse_below(self, kills=2, kills_per_run=1, inputs=1, batch=1, steps=1, seed=0)


def _kills(options: Options, report: dict[str, Any], scratch: Path) -> dict[str, Any]:
    """Half of the kills for each kind of run."""
    draw = np.random.default_rng(options.seed)
    each = options.kills // len(COMMANDS)
    return {kind: kill(kind, scratch / kind, each, options.kills_per_run, draw) for kind in COMMANDS}


def _disks(options: Options, report: dict[str, Any], scratch: Path) -> dict[str, Any]:
    """Full disks and read-only ones; of `train`."""
    if not disks.can_mount(scratch):
        raise SystemExit("the part disks has to mount small file systems, and this process may not")
    draw, undisturbed = np.random.default_rng(options.seed), scratch / "undisturbed"
    ended = end(begin("train", undisturbed))
    locked = [disks.lock("train", undisturbed, scratch, ended.seconds, draw) for _ in range(LOCKS)]
    return {"full": disks.fill("train", undisturbed, scratch, SHARES), "read_only": locked}


def _fuzz(options: Options, report: dict[str, Any], scratch: Path) -> dict[str, Any]:
    """Mutated sources, in batches with a process each, so that one that is stopped costs no other."""
    batches = []
    for number, first in enumerate(range(0, options.inputs, options.batch)):
        count, seed = min(options.batch, options.inputs - first), options.seed + number
        program = [sys.executable, "-m", "benchmarks.faults.fuzz", str(count), str(seed), str(options.kept)]
        ran = subprocess.run(program, capture_output=True, text=True)
        if ran.returncode:
            batches.append({"inputs": count, "seed": seed, "stopped": ran.stderr[-1000:]})
        else:
            batches.append(json.loads(ran.stdout.splitlines()[-1]))
        print(batches[-1], flush=True)
    return {"inputs": options.inputs, "batches": batches}


def _physics(options: Options, report: dict[str, Any], scratch: Path) -> dict[str, Any]:
    """Chunks of every task in turn, until all have their share of the steps."""
    names = [name for name in task_names() if name.startswith(("match_regions", "shoes_in_box"))]
    counts = report.get("physics", {}).get("tasks", {})
    counts = {name: counts.get(name, {"steps": 0, "bad": 0, "chunks": 0}) for name in names}
    for name, count in counts.items():
        while count["steps"] < options.steps / len(names):
            made = random_steps(name, options.seed + count["chunks"])
            count["steps"], count["bad"] = count["steps"] + made["steps"], count["bad"] + made["bad"]
            count["chunks"] += 1
            _write(options, report, "physics", {"tasks": counts})
        print(name, count, flush=True)
    totals = {key: sum(count[key] for count in counts.values()) for key in ("steps", "bad")}
    return {"tasks": counts, **totals}


PARTS: dict[str, Callable[[Options, dict[str, Any], Path], dict[str, Any]]] = {
    "kills": _kills,
    "disks": _disks,
    "fuzz": _fuzz,
    "physics": _physics,
}


def _write(options: Options, report: dict[str, Any], part: str, found: dict[str, Any]) -> None:
    """Puts what a part has found into the report, with how it was measured, and writes the report."""
    report[part] = {**found, **measured_on("faults")}
    write_json(options.out, report)


def main() -> None:
    """Reads the command line."""
    options = tyro.cli(Options, description=__doc__)
    configure()
    report = read_json(options.out) if options.out.exists() else {}
    for part in options.parts:
        scratch = Path(tempfile.mkdtemp(prefix="faults_"))
        try:
            _write(options, report, part, PARTS[part](options, report, scratch))
        finally:
            shutil.rmtree(scratch, ignore_errors=True)
    print(f"written: {options.out}")


if __name__ == "__main__":
    main()
