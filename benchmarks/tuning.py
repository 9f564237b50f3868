"""What every learned reward was tuned on: the same six settings each, by the audit of an encoder of a seed of its own.

    for reward in graph graph_with_robot graphirl graphirl_with_robot xirl; do
      graphrl sweep --reward $reward --encoders-only --first-seed 100 --out runs/tuning/$reward \\
        --sweep pretrain.learning_rate=1e-3,3e-3 pretrain.temperature=0.01,0.1,1
    done
    python -m benchmarks.tuning runs/tuning

Chosen is the setting whose reward puts most pairs of random scenes in order; no policy is trained, and scenes and
demonstrations are of a seed that nothing else uses. Writes benchmarks/results/tuning.json, which `benchmarks.table1`
reads.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tyro

from benchmarks.context import measured_on
from graphrl_jax.experiment.methods import METHODS
from graphrl_jax.storage import read_json, write_json

RESULT = Path(__file__).parent / "results" / "tuning.json"
LEARNED = tuple(name for name, method in METHODS.items() if method.encoder)
TUNED = ("learning_rate", "temperature")
"""Fields of `PretrainHyper` that are tuned."""
MEASURE = "pair_accuracy"


@dataclass(frozen=True)
class Options:
    """Puts finished sweeps together.

    Attributes:
      sweeps: folder with a sweep per reward, of that name.
    """

    sweeps: tyro.conf.Positional[Path]


def chosen(method: str) -> dict[str, float]:
    """Floats of pretraining chosen for a method; none for one that was not tuned."""
    if not RESULT.exists():
        return {}
    return read_json(RESULT)["rewards"].get(method, {}).get("chosen", {})


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
    """Chooses, prints and writes."""
    options = tyro.cli(Options, description=__doc__)
    missing = [name for name in LEARNED if not (options.sweeps / name / "sweep.json").exists()]
    if missing:
        raise SystemExit(
            f"{options.sweeps} lacks finished sweeps of {', '.join(missing)}; needed: {', '.join(LEARNED)}"
        )
    rewards = {name: tuned(options.sweeps / name) for name in LEARNED}
    for name, found in rewards.items():
        print(name, found["chosen"])
    write_json(RESULT, {"rewards": rewards, "measure": MEASURE, **measured_on("tuning")})


if __name__ == "__main__":
    main()
