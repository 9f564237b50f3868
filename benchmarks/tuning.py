"""What every learned row of Table I is tuned on: the same six settings, by the audit of an encoder of its own seed.

    python -m benchmarks.tuning [--rows graph xirl_paper]

Chosen is the setting whose reward puts most pairs of random scenes in order; no policy is trained, and scenes and
demonstrations are of a seed that nothing else uses. Encoders are a sweep per row in `--sweeps`; what is there already
is used again. Writes benchmarks/results/tuning.json, which `benchmarks.table1` reads; a row that is not asked for keeps
what the file has.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import tyro

from benchmarks import members
from benchmarks.checks import refuse_unknown
from benchmarks.context import measured_on
from benchmarks.rows import ROWS
from graphrl_jax.cli.requests import Sweep
from graphrl_jax.storage import read_json, write_json

SWEPT = ("pretrain.learning_rate=1e-3,3e-3", "pretrain.temperature=0.01,0.1,1")
TUNED = ("learning_rate", "temperature")
"""Fields of `PretrainHyper` that are tuned."""
SEED = 100
RESULT = Path(__file__).parent / "results" / "tuning.json"
MEASURE = "pair_accuracy"
_LEARNED = tuple(name for name, row in ROWS.items() if row.learned)


@dataclass(frozen=True)
class Options:
    """Tries the settings and chooses.

    Attributes:
      rows: learned rows of Table I.
      encoder_steps: steps per encoder; the preset's if left out.
      sweeps: folder with a sweep per row, of that name.
    """

    rows: tuple[str, ...] = _LEARNED
    encoder_steps: int | None = None
    sweeps: Path = Path("runs/tuning")

    def __post_init__(self) -> None:
        refuse_unknown("--rows", self.rows, _LEARNED)


def chosen(row: str) -> dict[str, float]:
    """Floats of pretraining chosen for a row; none for one that was not tuned."""
    if not RESULT.exists():
        return {}
    return read_json(RESULT)["rewards"].get(row, {}).get("chosen", {})


def swept(row: str, options: Options) -> Path:
    """The folder of a row's finished sweep."""
    folder, asked = options.sweeps / row, dict(ROWS[row].floats)
    if options.encoder_steps is not None:
        asked["steps"] = options.encoder_steps
    new = Sweep(out=folder, reward=ROWS[row].method, sweep=SWEPT, first_seed=SEED, encoders_only=True)
    members.finish_sweep(replace(new, pretrain=replace(new.pretrain, **asked)))
    return folder


def tuned(sweep: Path) -> dict[str, Any]:
    """The settings that a sweep tried, and the best one."""
    tried = [
        {
            **{name.partition(".")[2]: value for name, value in member["swept"].items()},
            **{name: value for name, value in member["encoder"].items() if isinstance(value, float)},
        }
        for member in read_json(sweep / "sweep.json")["members"]
    ]
    best = max(tried, key=lambda one: one[MEASURE])
    request = read_json(sweep / "config.json")["request"]
    return {
        "chosen": {name: best[name] for name in TUNED},
        "tried": tried,
        "seed": request["first_seed"],
        "encoder_steps": request.get("pretrain", {}).get("steps"),
    }


def main() -> None:
    """Tries, chooses, prints and writes."""
    options = tyro.cli(Options, description=__doc__)
    rewards = read_json(RESULT)["rewards"] if RESULT.exists() else {}
    for row in options.rows:
        rewards[row] = {**tuned(swept(row, options)), **measured_on("tuning")}
        print(row, rewards[row]["chosen"], flush=True)
        write_json(RESULT, {"rewards": rewards, "measure": MEASURE, **measured_on("tuning")})


if __name__ == "__main__":
    main()
