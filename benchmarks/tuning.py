"""What every learned reward of Tables I and II is tuned on: the same six settings, by the audit of an encoder each.

    python -m benchmarks.tuning [--tables table2] [--rows graph xirl_paper]

No policy is trained. Chosen is, for Table I, the setting whose reward puts most pairs of random scenes in order, and
for Table II that with the lowest rho (Eq. 4) on held-out demonstrations. All encoders, scenes and demonstrations are of
a seed that nothing else uses. Encoders are a sweep per row in `--sweeps`; what is there already is used again. Writes
benchmarks/results/tuning.json, which both tables read; a row that is not asked for keeps what the file has.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import tyro

from benchmarks import members
from benchmarks.checks import refuse_unknown
from benchmarks.context import measured_on
from benchmarks.rows import IMAGES, LEARNED, ROWS
from graphrl_jax.cli.requests import Sweep
from graphrl_jax.storage import read_json, write_json

SWEPT = ("pretrain.learning_rate=1e-3,3e-3", "pretrain.temperature=0.01,0.1,1")
TUNED = ("learning_rate", "temperature")
"""Fields of `PretrainHyper` that are tuned."""
SEED = 100
RESULT = Path(__file__).parent / "results" / "tuning.json"


@dataclass(frozen=True)
class Tuning:
    """How the rows of a table are tuned.

    Attributes:
      task: whose demonstrations encoders learn from.
      rows: methods, and floats of `PretrainHyper` in which a row differs from its method's defaults, by row.
      measure: what an audit is chosen by, in words.
      value: of an audit; the greatest is chosen.
    """

    task: str
    rows: Mapping[str, tuple[str, Mapping[str, float]]]
    measure: str
    value: Callable[[Mapping[str, Any]], float]


_DEMO = Tuning(
    task="match_regions",
    rows={name: (row.method, row.floats) for name, row in ROWS.items() if row.learned},
    measure="pairs of random scenes in order",
    value=lambda audit: audit["pair_accuracy"],
)
TABLES = {
    "table1": _DEMO,
    "table1_layout": replace(_DEMO, task="match_regions_layout"),
    "table2": Tuning(
        task="shoes_in_box",
        # The task draws no images inside a program, as the audits of a sweep need.
        rows={name: (name, {}) for name in LEARNED if name != IMAGES},
        measure="minus rho on held-out demonstrations",
        value=lambda audit: -audit["discrimination"]["rho"],
    ),
}
"""By name; Table I has one for each of its grounds, the first of them Demo."""
_ROWS = tuple(dict.fromkeys(row for table in TABLES.values() for row in table.rows))


@dataclass(frozen=True)
class Options:
    """Tries the settings and chooses.

    Attributes:
      tables: whose rows are tuned.
      rows: those that are tuned, in every table that has them.
      encoder_steps: steps per encoder; the preset's if left out.
      sweeps: folder with a sweep per table and row.
    """

    tables: tuple[str, ...] = tuple(TABLES)
    rows: tuple[str, ...] = _ROWS
    encoder_steps: int | None = None
    sweeps: Path = Path("runs/tuning")

    def __post_init__(self) -> None:
        refuse_unknown("--tables", self.tables, TABLES)
        refuse_unknown("--rows", self.rows, _ROWS)


def chosen(table: str, row: str) -> dict[str, float]:
    """Floats of pretraining chosen for a row of a table; none for one that was not tuned."""
    return _kept().get(table, {}).get(row, {}).get("chosen", {})


def swept(table: str, row: str, options: Options) -> Path:
    """The folder of a row's finished sweep."""
    tuning, folder = TABLES[table], options.sweeps / table / row
    method, floats = tuning.rows[row]
    asked = dict(floats)
    if options.encoder_steps is not None:
        asked["steps"] = options.encoder_steps
    new = Sweep(out=folder, task=tuning.task, reward=method, sweep=SWEPT, first_seed=SEED, encoders_only=True)
    members.finish_sweep(replace(new, pretrain=replace(new.pretrain, **asked)))
    return folder


def tuned(table: str, sweep: Path) -> dict[str, Any]:
    """The settings that a sweep tried, what each is worth, and the best one."""
    value = TABLES[table].value
    tried = [
        {name.partition(".")[2]: one for name, one in member["swept"].items()} | {"value": value(member["encoder"])}
        for member in read_json(sweep / "sweep.json")["members"]
    ]
    best = max(tried, key=lambda one: one["value"])
    request = read_json(sweep / "config.json")["request"]
    return {
        "chosen": {name: best[name] for name in TUNED},
        "tried": tried,
        "seed": request["first_seed"],
        "encoder_steps": request.get("pretrain", {}).get("steps"),
    }


def _kept() -> dict[str, Any]:
    return read_json(RESULT)["tables"] if RESULT.exists() else {}


def main() -> None:
    """Tries, chooses, prints and writes."""
    options = tyro.cli(Options, description=__doc__)
    for table in options.tables:
        for row in [row for row in TABLES[table].rows if row in options.rows]:
            found = {**tuned(table, swept(table, row, options)), **measured_on("tuning")}
            print(table, row, found["chosen"], flush=True)
            tables = _kept()
            tables[table] = tables.get(table, {}) | {row: found}
            measures = {name: tuning.measure for name, tuning in TABLES.items()}
            write_json(RESULT, {"tables": tables, "measures": measures, **measured_on("tuning")})


if __name__ == "__main__":
    main()
