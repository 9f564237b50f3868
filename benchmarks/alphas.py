"""A sweep over alpha in one program: 5 alphas x 5 seeds, policies trained to the end. One command:

    python -m benchmarks.alphas [--no-train] [--task match_regions_layout]

It trains on a ground where other objects lie in the way, because alpha weighs objects that have moved against others.
An interrupted sweep goes on. Without training, what the sweep has so far is put together: its encoders, and success in
training. Writes alphas.json and alphas.png to `benchmarks/results`.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tyro

from benchmarks import members
from benchmarks.context import RESULTS, measured_on
from graphrl_jax.cli.requests import Sweep
from graphrl_jax.experiment.run_directory import Run
from graphrl_jax.storage import read_json, write_json
from graphrl_jax.viz import plots

FIELD = "pretrain.alpha"
ALPHAS = "1,2,4,8,16"
FIRST_SEED = 40
"""Seeds of the sweep are those of no other result."""


@dataclass(frozen=True)
class Options:
    """Carries the sweep out and puts its members together.

    Attributes:
      sweep: its folder.
      task: where policies are trained and judged.
      seeds: of every alpha.
      updates: policy updates; the task's number if left out.
      train: carry out what is left of the sweep.
    """

    sweep: Path = Path("runs/alphas")
    task: str = "match_regions_layout"
    seeds: int = 5
    updates: int | None = None
    train: bool = True


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
        **{name: request[name] for name in ("task", "alphas", "seeds", "first_seed", "updates")},
        "encoder_steps": request["pretrain"]["steps"],
        "preset": config["members"][0]["settings"]["preset"],
    }


def main() -> None:
    """Collects, draws and writes."""
    options = tyro.cli(Options, description=__doc__)
    if options.train:
        asked = {"task": options.task, "seeds": options.seeds, "updates": options.updates}
        members.finish_sweep(Sweep(out=options.sweep, alphas=ALPHAS, first_seed=FIRST_SEED, **asked))
    rows = members_of(options.sweep)
    if not rows:
        raise SystemExit(f"{options.sweep} holds no member with an encoder.json")
    asked = asked_of(options.sweep)
    write_json(RESULTS / "alphas.json", {"members": rows, "sweep": asked, **measured_on("alphas")})
    plots.sweep(rows, FIELD, RESULTS / "alphas.png")


if __name__ == "__main__":
    main()
