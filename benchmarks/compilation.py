"""Seconds of compilation by program, of a smoke run with an empty cache and of one with a full one. One command:

    python -m benchmarks.compilation [--before ../earlier]

`--before` is a folder with the sources of an earlier commit, whose runs are measured beside, in turn with this one's.
Every run is a process of its own. Writes `benchmarks/results/compilation.json`.
"""

import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tyro

from benchmarks.checks import refuse_no_checkout
from benchmarks.context import RESULTS, measured_on
from graphrl_jax.storage import read_json, write_json

RUN = ("train", "--task", "match_regions", "--preset", "smoke")
_COMPILED = re.compile(r"Finished XLA compilation of jit\((\S+)\) in ([\d.e-]+)")
_LEAST_S = 0.5
"""Programs that take less are summed up as others."""


@dataclass(frozen=True)
class Options:
    """Measures smoke runs.

    Attributes:
      before: folder of earlier sources.
      out: where the numbers go.
    """

    before: Path | None = None
    out: Path = RESULTS / "compilation.json"

    def __post_init__(self) -> None:
        refuse_no_checkout("--before", self.before)


def by_program(log: str) -> dict[str, float]:
    """Seconds of compilation by the name of the program, longest first, from the log of a run."""
    seconds: dict[str, float] = {}
    for name, spent in _COMPILED.findall(log):
        seconds[name] = seconds.get(name, 0.0) + float(spent)
    long = {name: spent for name, spent in seconds.items() if spent >= _LEAST_S}
    others = sum(seconds.values()) - sum(long.values())
    return dict(sorted(long.items(), key=lambda item: -item[1])) | {"others": others}


def smoke(sources: Path, cache: Path, out: Path) -> dict[str, Any]:
    """One run: seconds in all and in programs' compilation."""
    environment = {**os.environ, "PYTHONPATH": str(sources.absolute()), "JAX_COMPILATION_CACHE_DIR": str(cache)}
    command = [sys.executable, "-m", "graphrl_jax", *RUN, "--out", str(out)]
    done = subprocess.run(
        command, cwd=sources, env={**environment, "JAX_LOG_COMPILES": "1"}, capture_output=True, text=True, check=True
    )
    return {"wall_s": read_json(out / "summary.json")["wall_s"], "programs": by_program(done.stderr)}


def measure(sources: Mapping[str, Path], folder: Path) -> dict[str, Any]:
    """Runs with an empty cache, then with a full one, the sources in turn."""
    return {
        cache: {name: smoke(path, folder / name / "cache", folder / name / cache) for name, path in sources.items()}
        for cache in ("cold", "warm")
    }


def main() -> None:
    """Measures, prints and writes."""
    options = tyro.cli(Options, description=__doc__)
    sources = {"before": options.before, "now": Path()}
    with tempfile.TemporaryDirectory() as folder:
        found = measure({name: path for name, path in sources.items() if path is not None}, Path(folder))
    write_json(options.out, {**found, **measured_on("compilation")})
    for cache, runs in found.items():
        print(cache, {name: round(run["wall_s"], 1) for name, run in runs.items()})


if __name__ == "__main__":
    main()
