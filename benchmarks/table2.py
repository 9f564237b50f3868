"""Table II: how every learned reward tells successes from failures on Shoes in Box (Eq. 4 and its companions).

    python -m benchmarks.table2 [--preset smoke] [--methods graph xirl graph_no_activity] [--seeds 0 1 2]

Beside the learned rewards stand ours without each of its parts. All learn from the same demonstrations, with the
default floats, and are judged on the same unseen successes and failures; both are those of `benchmarks.shoes_in_box`.
XIRL sees them through MuJoCo's renderer, which needs a graphics library. What is in `--out` already is used again,
encoder by encoder. Writes table2.json to `benchmarks/results` (smoke: to `--out`).
"""

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Literal

import tyro

from benchmarks.checks import refuse_unknown
from benchmarks.context import RESULTS, measured_on
from benchmarks.rows import LEARNED
from benchmarks.shoes_in_box import (
    TRAINING_SEED,
    VALIDATION_SEED,
    demonstrations,
    discriminate_cuts,
    trained,
    true_progress,
)
from graphrl_jax.experiment.methods import ABLATIONS
from graphrl_jax.experiment.settings import Settings, compose
from graphrl_jax.registry import make_task
from graphrl_jax.reward.model import demonstration_rewards
from graphrl_jax.runtime import configure
from graphrl_jax.storage import write_json
from tasks.shoes_in_box.task import ShoesInBox

ABLATED = {f"graph_no_{ablation}": ablation for ablation in ABLATIONS}
REWARDS: dict[str, tuple[str, tuple[str, ...]]] = {
    **{name: (name, ()) for name in LEARNED},
    **{name: ("graph", (ablation,)) for name, ablation in ABLATED.items()},
}
"""Methods, and what is left out of them."""


@dataclass(frozen=True)
class Options:
    """Trains what is missing and puts Table II together.

    Attributes:
      preset: smoke tries everything on little.
      methods: learned rewards, and ours without one of its parts.
      seeds: of each.
      out: folder of demonstrations and encoders; runs/table2_PRESET if left out.
    """

    preset: Literal["smoke", "default"] = "default"
    methods: tuple[str, ...] = tuple(REWARDS)
    seeds: tuple[int, ...] = (0, 1, 2, 3, 4)
    out: Path | None = None

    def __post_init__(self) -> None:
        refuse_unknown("--methods", self.methods, REWARDS)


def settings_of(task: ShoesInBox, name: str, preset: str) -> Settings:
    """The settings that the encoder of one of `REWARDS` is trained with."""
    method, ablations = REWARDS[name]
    return compose(task, method, "smoke" if preset == "smoke" else "cpu", ablations=ablations)


def main() -> None:
    """Trains, judges, prints and writes."""
    options = tyro.cli(Options, description=__doc__)
    configure()
    where = measured_on("table2")
    out = options.out or Path("runs") / f"table2_{options.preset}"
    task = make_task("shoes_in_box")
    assert isinstance(task, ShoesInBox)
    rows = []
    for name in options.methods:
        settings = settings_of(task, name, options.preset)
        fitted, unseen = demonstrations(task, out, options.preset, settings.image_size)
        for seed in options.seeds:
            model = trained(task, fitted, name, replace(settings, seed=seed), out)
            found = discriminate_cuts(partial(demonstration_rewards, model), unseen)
            rows.append({"reward": name, "seed": seed, **found})
            shown = {cut: found[cut]["rho"] for cut in found}
            print(name, seed, shown, flush=True)
    _, unseen = demonstrations(task, out, options.preset)
    report = {
        "rewards": rows,
        "true_progress": discriminate_cuts(true_progress, unseen),
        "seeds": {"demonstrations": TRAINING_SEED, "validation": VALIDATION_SEED},
        **where,
    }
    write_json((out if options.preset == "smoke" else RESULTS) / "table2.json", report)


if __name__ == "__main__":
    main()
