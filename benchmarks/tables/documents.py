"""Which document has which tables."""

from collections.abc import Callable

from benchmarks.tables.cells import ROOT
from benchmarks.tables.compilation import compilation_table
from benchmarks.tables.costs import (
    cores_table,
    layout_speedup_table,
    pytorch_table,
    scale_table,
    shoes_speedup_table,
    speedup_table,
    sweeps_table,
    throughput_table,
)
from benchmarks.tables.faults import faults_table
from benchmarks.tables.first_run import first_run_table
from benchmarks.tables.human import fidelity_table, human_table
from benchmarks.tables.markers import names_in, updated
from benchmarks.tables.match_regions import (
    alphas_table,
    audit_table,
    earlier_table_1,
    headline,
    success_table,
    variants_table,
)
from benchmarks.tables.scores import scores_table
from benchmarks.tables.shoes_in_box import (
    alpha_default_table,
    discrimination_table,
    failures_table,
    kinds_table,
    subtasks_table,
    table_2,
)
from benchmarks.tables.shoes_policies import policies_table
from benchmarks.tables.stable_baselines import stable_baselines_table
from benchmarks.tables.table1 import improvement_table, table_1

DOCUMENTS: dict[str, dict[str, tuple[Callable[[], str], ...]]] = {
    "README.md": {"headline results": (headline,)},
    "docs/results.md": {
        "results of Table I": (table_1, improvement_table),
        "results of the earlier Table I": (earlier_table_1,),
        "results of Match Regions": (success_table, audit_table),
        "results of throughput": (
            throughput_table,
            speedup_table,
            layout_speedup_table,
            shoes_speedup_table,
            pytorch_table,
        ),
        "results of cores": (cores_table, scale_table),
        "results of Table II": (table_2, kinds_table, alpha_default_table),
        "results of variants": (variants_table,),
        "results of Shoes in Box": (discrimination_table, failures_table, subtasks_table),
        "results of policies on Shoes in Box": (policies_table,),
        "results of human demonstrations": (human_table, fidelity_table),
        "results of scores": (scores_table,),
        "results of sweeps": (sweeps_table,),
        "results of compilation": (compilation_table,),
        "results of first runs": (first_run_table,),
        "results of Stable-Baselines3": (stable_baselines_table,),
        "results of alphas": (alphas_table,),
        "results of faults": (faults_table,),
    },
}
"""Tables by the name of their marker, for each document."""
BLOCKS = {name: tables for blocks in DOCUMENTS.values() for name, tables in blocks.items()}


def document(name: str) -> str:
    """What a document says once all of its tables are written anew.

    Raises:
      ValueError: its markers are not those of its tables.
    """
    text = (ROOT / name).read_text()
    if sorted(names_in(text)) != sorted(DOCUMENTS[name]):
        raise ValueError(f"{name} has the markers {names_in(text)}; needed: {list(DOCUMENTS[name])}, each once")
    return with_tables(text)


def with_tables(text: str) -> str:
    """A text with every table in it written anew; what is outside the markers stays.

    Raises:
      ValueError: a marker is unknown, or has no end.
    """
    for name in names_in(text):
        if name not in BLOCKS:
            raise ValueError(f"no tables are called {name!r}; known: {', '.join(BLOCKS)}")
        written = filter(None, (table() for table in BLOCKS[name]))
        text = updated(text, "\n\n".join(written) + "\n", name)
    return text
