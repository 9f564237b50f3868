"""Table II: how every learned reward tells successes from failures on Shoes in Box (Eq. 4 and its companions).

    python -m benchmarks.table2 [--preset smoke] [--methods graph xirl graph_no_activity] [--seeds 0 1 2]

Beside the learned rewards stand ours without each of its parts. All learn from the same demonstrations, with the
default floats, and are judged on the same unseen successes and failures; both are those of `benchmarks.shoes_in_box`.
XIRL sees them through MuJoCo's renderer, which needs a graphics library. What is in `--out` already is used again,
encoder by encoder. Writes table2.json to `benchmarks/results` (smoke: to `--out`).
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import tyro

from benchmarks.context import measured_on
from benchmarks.shoes_in_box import (
    PRESETS,
    TRAINING_SEED,
    VALIDATION_SEED,
    discriminate,
    kept_demonstrations,
    trained,
    true_progress,
    whole_episodes,
)
from benchmarks.tuning import LEARNED
from graphrl_jax import pipeline
from graphrl_jax.compilation import configure
from graphrl_jax.demonstrations import Demonstrations
from graphrl_jax.reward import demonstration_rewards
from graphrl_jax.runs import write_json
from graphrl_jax.settings import ABLATIONS, Ablation, Settings
from graphrl_jax.task import make_task
from tasks.shoes_in_box.env import ShoesInBox

RESULTS = Path("benchmarks/results")
ABLATED: dict[str, Ablation] = {f"graph_no_{ablation}": ablation for ablation in ABLATIONS}
METHODS = (*LEARNED, *ABLATED)


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
    methods: tuple[str, ...] = METHODS
    seeds: tuple[int, ...] = (0, 1, 2, 3, 4)
    out: Path | None = None

    def __post_init__(self) -> None:
        for method in self.methods:
            if method not in METHODS:
                raise ValueError(f"--methods {method!r}; allowed: {', '.join(METHODS)}")


def demonstrations(task: ShoesInBox, out: Path, preset: str, size: int | None) -> tuple[Demonstrations, Demonstrations]:
    """What rewards learn from and what they are judged on, with pictures of `size` if wanted."""
    sizes, end = PRESETS[preset], "" if size is None else f"_{size}"
    return (
        kept_demonstrations(task, out / f"demonstrations{end}.npz", TRAINING_SEED, sizes.demonstrations, 0, size),
        kept_demonstrations(task, out / f"validation{end}.npz", VALIDATION_SEED, sizes.successes, sizes.failures, size),
    )


def settings_of(method: str, preset: str) -> Settings:
    """The settings that a method's encoder is trained with."""
    ablations = (ABLATED[method],) if method in ABLATED else ()
    reward = "graph" if ablations else method
    return Settings(reward=reward, preset="smoke" if preset == "smoke" else "cpu", ablations=ablations)  # type: ignore[arg-type]


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
        settings = settings_of(name, options.preset)
        config = settings.pretraining
        hyper = pipeline.pretrain_hyper(task, task.pretraining.alpha, settings.reward, settings.ablations)
        fitted, unseen = demonstrations(task, out, options.preset, config.encoder.picture_size)
        for seed in options.seeds:
            model = trained(task, fitted, name, seed, config, hyper, out)
            row = {"reward": name, "seed": seed}
            for cut, demos in (("demonstrations", unseen), ("whole_episodes", whole_episodes(unseen))):
                row[cut] = discriminate(np.asarray(demonstration_rewards(model, demos)), demos)
            rows.append(row)
            print(name, seed, {cut: row[cut]["rho"] for cut in ("demonstrations", "whole_episodes")}, flush=True)
    _, unseen = demonstrations(task, out, options.preset, None)
    progress = true_progress(unseen)
    report = {
        "rewards": rows,
        "true_progress": {
            "demonstrations": discriminate(progress, unseen),
            "whole_episodes": discriminate(progress, whole_episodes(unseen)),
        },
        "seeds": {"demonstrations": TRAINING_SEED, "validation": VALIDATION_SEED},
        **where,
    }
    write_json((out if options.preset == "smoke" else RESULTS) / "table2.json", report)


if __name__ == "__main__":
    main()
