"""What a finished sweep over alpha found, as a result file and figure.

    graphrl sweep --alphas 1,2,4,8,16 --seeds 2 --first-seed 40 --updates 100 --out runs/alphas
    python -m benchmarks.alphas runs/alphas

Of a sweep that is not done with its policies yet, the encoders count, and success in training so far. Writes
alphas.json and alphas.png to benchmarks/results.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tyro

from benchmarks.context import RESULTS, measured_on
from graphrl_jax.experiment.run_directory import Run
from graphrl_jax.storage import read_json, write_json
from graphrl_jax.viz import plots

FIELD = "pretrain.alpha"


@dataclass(frozen=True)
class Options:
    """Puts a sweep's members together.

    Attributes:
      sweep: its folder.
    """

    sweep: tyro.conf.Positional[Path]


def members_of(sweep: Path) -> list[dict[str, Any]]:
    """Every member with an encoder: alpha, seed, the audit, how far its policy is and how it did in training then, and
    the success rate once it is done.
    """
    rows = []
    for encoder in sorted(sweep.glob("*/encoder.json")):
        config, summary = read_json(encoder.parent / "config.json"), encoder.parent / "summary.json"
        row = {"swept": {FIELD: config["pretrain"]["alpha"]}, "seed": config["seed"], "encoder": read_json(encoder)}
        if lines := Run(encoder.parent).records("ppo"):
            row["training"] = {name: lines[-1][name] for name in ("env_steps", "success")}
        if summary.exists():
            row["success_rate"] = read_json(summary)["success_rate"]
        rows.append(row)
    return sorted(rows, key=lambda row: (row["swept"][FIELD], row["seed"]))


def asked_of(sweep: Path) -> dict[str, Any]:
    """What a sweep was asked for; None is what was left to the preset."""
    config = read_json(sweep / "config.json")
    request = config["request"]
    return {
        **{name: request[name] for name in ("alphas", "seeds", "first_seed", "updates")},
        "encoder_steps": request["pretrain"]["steps"],
        "preset": config["members"][0]["settings"]["preset"],
    }


def main() -> None:
    """Collects, draws and writes."""
    options = tyro.cli(Options, description=__doc__)
    rows = members_of(options.sweep)
    if not rows:
        raise SystemExit(f"{options.sweep} holds no member with an encoder.json")
    asked = asked_of(options.sweep)
    write_json(RESULTS / "alphas.json", {"members": rows, "sweep": asked, **measured_on("alphas")})
    plots.sweep(rows, FIELD, RESULTS / "alphas.png")


if __name__ == "__main__":
    main()
