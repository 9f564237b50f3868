"""How long a first run takes: `graphrl train` with an empty compilation cache, from the command to the evaluation.

    python -m benchmarks.first_run [--rewards graph] [--seeds 203 204 205]

Every run is a process of its own with all defaults, so it ends early once its policy solves enough unseen episodes
(`--stop-at`); its seconds are those of the whole process. Judged are the 256 episodes of its final evaluation, which
are others. Leave the machine alone meanwhile. Writes first_run.json to `benchmarks/results`.
"""

import os
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tyro

from benchmarks.checks import refuse_unknown
from benchmarks.context import RESULTS, measured_on
from graphrl_jax.experiment.methods import METHODS
from graphrl_jax.storage import read_json, write_json

KEPT = ("success_rate", "episodes", "env_steps", "train_steps_per_s", "compile_s", "compilation_cache")


@dataclass(frozen=True)
class Options:
    """Measures whole runs.

    Attributes:
      preset: sizes of a run; smoke tries everything on little.
      rewards: what policies are trained on.
      seeds: of each reward; those of no other result.
      out: where the numbers go.
    """

    preset: str = "cpu"
    rewards: tuple[str, ...] = ("graph",)
    seeds: tuple[int, ...] = (203, 204, 205)
    out: Path = RESULTS / "first_run.json"

    def __post_init__(self) -> None:
        refuse_unknown("--rewards", self.rewards, METHODS)


def first_run(reward: str, seed: int, preset: str, folder: Path) -> dict[str, Any]:
    """One run: seconds of the process, and what its summary says."""
    out = folder / f"{reward}_{seed}"
    command = [sys.executable, "train.py", "--reward", reward, "--seed", str(seed), "--preset", preset]
    environment = {**os.environ, "JAX_COMPILATION_CACHE_DIR": str(folder / f"cache_{reward}_{seed}")}
    started = time.perf_counter()
    subprocess.run([*command, "--out", str(out)], env=environment, check=True)
    seconds = time.perf_counter() - started
    summary = read_json(out / "summary.json")
    encoder = {"pretrain_s": summary["encoder"]["pretrain_s"]} if "encoder" in summary else {}
    return {"reward": reward, "seed": seed, "seconds": seconds, **encoder, **{name: summary[name] for name in KEPT}}


def main() -> None:
    """Measures, prints and writes."""
    options = tyro.cli(Options, description=__doc__)
    where = measured_on("first_run")
    runs = []
    with tempfile.TemporaryDirectory() as folder:
        for reward in options.rewards:
            for seed in options.seeds:
                runs.append(first_run(reward, seed, options.preset, Path(folder)))
                print(f"{reward} {seed}: {runs[-1]['success_rate']:.1%} after {runs[-1]['seconds'] / 60:.1f} minutes")
                write_json(options.out, {"runs": runs, **where})


if __name__ == "__main__":
    main()
