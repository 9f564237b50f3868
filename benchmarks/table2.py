"""Table II: how every learned reward tells successes from failures on Shoes in Box (Eq. 4 and its companions).

    python -m benchmarks.table2 [--preset smoke] [--rows graph xirl graph_no_activity] [--seeds 0 1 2]
                                [--budget-minutes 60]

Floats are those that `benchmarks.tuning` chose; XIRL's are those of Table I, where it learns in the same way. Beside
the learned rewards stand ours without each of its parts, with the floats of ours. All learn from the same
demonstrations and are judged on the same unseen successes and failures; both are those of `benchmarks.shoes_in_box`.
XIRL sees them through MuJoCo's renderer, which needs a graphics library. Encoders are trained one after another, one
seed of every row in turn. What is in `--out` already is used again. A budget of 0 trains nothing. Writes table2.json to
`benchmarks/results` (smoke: to `--out`), from all encoders in `--out` and those that an earlier result file holds;
`missing` names those that the whole table still lacks.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal

import tyro

from benchmarks import members, rows
from benchmarks.checks import refuse_unknown
from benchmarks.context import RESULTS, measured_on
from benchmarks.rows import IMAGES, LEARNED, OURS
from benchmarks.shoes_in_box import (
    TRAINING_SEED,
    VALIDATION_SEED,
    demonstrations,
    discriminate_cuts,
    trained,
    true_progress,
)
from benchmarks.statistics import improvement, interquartile_mean_of
from benchmarks.tuning import chosen
from graphrl_jax.experiment.methods import ABLATIONS
from graphrl_jax.experiment.settings import Settings, compose
from graphrl_jax.registry import make_task
from graphrl_jax.reward.card import MODEL
from graphrl_jax.reward.model import demonstration_rewards
from graphrl_jax.runtime import configure
from graphrl_jax.storage import read_json, write_json
from tasks.shoes_in_box.task import ShoesInBox

ABLATED = {f"{OURS}_no_{ablation}": ablation for ablation in ABLATIONS}
ROWS: dict[str, tuple[str, tuple[str, ...]]] = {
    **{name: (name, ()) for name in LEARNED},
    **{name: (OURS, (ablation,)) for name, ablation in ABLATED.items()},
}
"""Methods, and what is left out of them."""
MEASURES = (("demonstrations", "rho"), ("whole_episodes", "auroc"))
"""Cuts of the episodes, and the measures by which rows are compared."""
Judged = dict[str, Any]
"""An encoder: its row, seed and commit, and its discrimination by cut."""


@dataclass(frozen=True)
class Options:
    """Trains what is missing and puts Table II together.

    Attributes:
      preset: smoke tries everything on little.
      rows: learned rewards, and ours without one of its parts.
      seeds: of each; those of the whole table if left out.
      budget_minutes: no encoder is begun after so long; all if left out.
      out: folder of demonstrations and encoders; runs/table2_PRESET if left out.
    """

    preset: Literal["smoke", "default"] = "default"
    rows: tuple[str, ...] = tuple(ROWS)
    seeds: tuple[int, ...] | None = None
    budget_minutes: float | None = None
    out: Path | None = None

    def __post_init__(self) -> None:
        refuse_unknown("--rows", self.rows, ROWS)

    @property
    def folder(self) -> Path:
        """Folder of demonstrations and encoders."""
        return self.out or Path("runs") / f"table2_{self.preset}"


def seeds_of(row: str) -> tuple[int, ...]:
    """Seeds of a row in the whole table."""
    return tuple(range(rows.ROWS[ROWS[row][0]].seeds))


def settings_of(task: ShoesInBox, row: str, preset: str, seed: int = 0) -> Settings:
    """The settings that an encoder of a row is trained with."""
    method, ablations = ROWS[row]
    sizes = "smoke" if preset == "smoke" else "cpu"
    floats = chosen("table1", f"{IMAGES}_paper") if method == IMAGES else chosen("table2", method)
    return compose(task, method, sizes, seed, ablations=ablations, pretrain=floats)


def judged(task: ShoesInBox, row: str, seed: int, options: Options) -> Judged:
    """How an encoder, trained if it is missing, tells the unseen successes from the failures; judged once."""
    settings = settings_of(task, row, options.preset, seed)
    path = options.folder / f"{row}_{seed}"
    if not (path / "table2.json").exists():
        fitted, unseen = demonstrations(task, options.folder, options.preset, settings.image_size)
        model = trained(task, fitted, row, settings, options.folder)
        found = discriminate_cuts(partial(demonstration_rewards, model), unseen)
        write_json(path / "table2.json", {"reward": row, "seed": seed, **found, **measured_on("table2")})
    kept = read_json(path / "table2.json")
    return {name: kept[name] for name in ("reward", "seed", "demonstrations", "whole_episodes", "commit")}


def train_missing(task: ShoesInBox, options: Options) -> None:
    """Trains and judges encoders as long as the budget lasts."""
    wanted = members.in_turn({row: options.seeds or seeds_of(row) for row in options.rows})
    for row, seed in members.within(wanted, options.budget_minutes):
        found = judged(task, row, seed, options)
        print(row, seed, {cut: round(found[cut][name], 3) for cut, name in MEASURES}, flush=True)


def finished(task: ShoesInBox, options: Options, earlier: Sequence[Judged]) -> tuple[list[Judged], list[str]]:
    """All encoders in the folder, and earlier ones that are no longer there; and names of those that are missing."""
    there = {(one["reward"], one["seed"]): one for one in earlier}
    whole = [(row, seed) for row in ROWS for seed in seeds_of(row)]
    for row, seed in whole:
        if (options.folder / f"{row}_{seed}" / MODEL).exists():
            there[row, seed] = judged(task, row, seed, options)
    missing = [f"{row}_{seed}" for row, seed in whole if (row, seed) not in there]
    return [there[member] for member in whole if member in there], missing


def compared(encoders: Sequence[Judged]) -> dict[str, Any]:
    """Interquartile means by row and measure, and how probably an encoder of ours is better than one of another row."""
    found: dict[str, Any] = {}
    for cut, name in MEASURES:
        # A small rho is good, a large AUROC.
        sign = -1 if name == "rho" else 1
        values = {row: [sign * one[cut][name] for one in encoders if one["reward"] == row] for row in ROWS}
        values = {row: some for row, some in values.items() if some}
        ours = values.get(OURS)
        found[f"{name}, {cut}"] = {
            row: {
                **interquartile_mean_of([[sign * value for value in some]]),
                "improvement": improvement([ours], [some]) if ours and row != OURS else None,
            }
            for row, some in values.items()
        }
    return found


def main() -> None:
    """Trains, judges, prints and writes."""
    options = tyro.cli(Options, description=__doc__)
    configure()
    where = measured_on("table2")
    path = (options.folder if options.preset == "smoke" else RESULTS) / "table2.json"
    task = make_task("shoes_in_box")
    assert isinstance(task, ShoesInBox)
    train_missing(task, options)
    _, unseen = demonstrations(task, options.folder, options.preset)
    truth = discriminate_cuts(true_progress, unseen)
    earlier = read_json(path) if path.exists() else {}
    # Of other episodes if the truth differs.
    kept = earlier["rewards"] if earlier.get("true_progress") == truth else []
    encoders, missing = finished(task, options, kept)
    report = {
        "rewards": encoders,
        "compared": compared(encoders),
        "missing": missing,
        "true_progress": truth,
        "seeds": {"demonstrations": TRAINING_SEED, "validation": VALIDATION_SEED},
        **where,
    }
    write_json(path, report)
    print(f"missing: {len(missing)} encoders; written: {path}")


if __name__ == "__main__":
    main()
