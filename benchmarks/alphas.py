"""A sweep over alpha in one program: 5 alphas x 5 seeds, policies trained to the end. One command:

    python -m benchmarks.alphas [--no-train] [--task match_regions_layout]
    python -m benchmarks.alphas --task shoes_in_box --alphas 1,2,4 --temperatures 0.01,1 --seeds 3 --first-seed 100 \\
                                --encoders-only --encoder-steps 1500

It trains on a ground where other objects lie in the way, because alpha weighs objects that have moved against others.
The second command is what alpha's default on Shoes in Box follows from; no result is of its seeds. An interrupted sweep
goes on. Without training, what the sweep has so far is put together: its encoders, and success in training. Writes
alphas.json (of another task alphas_TASK.json) to `benchmarks/results`, and a figure if policies are trained.
"""

from dataclasses import dataclass, replace
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
GROUND = "match_regions_layout"


@dataclass(frozen=True)
class Options:
    """Carries the sweep out and puts its members together.

    Attributes:
      task: where policies are trained and judged.
      alphas: values of alpha.
      temperatures: values of the temperature, each with every alpha; the default alone if left out.
      seeds: of every alpha.
      first_seed: first of the seeds, which are those of no other result.
      updates: policy updates; the task's number if left out.
      encoder_steps: steps per encoder; the preset's if left out.
      encoders_only: train and audit encoders, no policies.
      train: carry out what is left of the sweep.
      sweep: its folder; runs/alphas_TASK if left out.
    """

    task: str = GROUND
    alphas: str = ALPHAS
    temperatures: str | None = None
    seeds: int = 5
    first_seed: int = 40
    updates: int | None = None
    encoder_steps: int | None = None
    encoders_only: bool = False
    train: bool = True
    sweep: Path | None = None

    @property
    def folder(self) -> Path:
        """Folder of the sweep."""
        return self.sweep or Path("runs") / f"alphas_{self.task}"

    @property
    def request(self) -> Sweep:
        """The sweep that is asked for."""
        temperatures = (f"pretrain.temperature={self.temperatures}",) if self.temperatures else ()
        new = Sweep(
            out=self.folder, task=self.task, alphas=self.alphas, sweep=temperatures, seeds=self.seeds,
            first_seed=self.first_seed, updates=self.updates, encoders_only=self.encoders_only,
        )  # fmt: skip
        return replace(new, pretrain=replace(new.pretrain, steps=self.encoder_steps))


def members_of(sweep: Path) -> list[dict[str, Any]]:
    """Every member with an encoder: alpha, seed, the audit, how far its policy is and how it did in training then, and
    the success rate once it is done.
    """
    rows = []
    for encoder in sorted(sweep.glob("*/encoder.json")):
        config, summary = read_json(encoder.parent / "config.json"), encoder.parent / "summary.json"
        floats = config["pretrain"]
        row = {"swept": {FIELD: floats["alpha"]}, "temperature": floats["temperature"], "seed": config["seed"]}
        row["encoder"] = read_json(encoder)
        if lines := Run(encoder.parent).records("ppo"):
            row["training"] = {name: lines[-1][name] for name in ("env_steps", "success")}
        if summary.exists():
            row["success_rate"] = read_json(summary)["success_rate"]
        rows.append(row)
    return sorted(rows, key=lambda row: (row["temperature"], row["swept"][FIELD], row["seed"]))


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
        members.finish_sweep(options.request)
    rows = members_of(options.folder)
    if not rows:
        raise SystemExit(f"{options.folder} holds no member with an encoder.json")
    path = RESULTS / f"alphas{'' if options.task == GROUND else '_' + options.task}.json"
    write_json(path, {"members": rows, "sweep": asked_of(options.folder), **measured_on("alphas")})
    if not options.encoders_only:
        plots.sweep(rows, FIELD, path.with_suffix(".png"))


if __name__ == "__main__":
    main()
