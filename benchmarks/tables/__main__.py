"""Writes the tables into both documents; see the package."""

from dataclasses import dataclass

import tyro

from benchmarks import tables
from benchmarks.tables.documents import DOCUMENTS, ROOT, document


@dataclass(frozen=True)
class Options:
    """Writes the tables of README.md and docs/results.md."""


def main() -> None:
    """Writes every document whose tables have changed."""
    tyro.cli(Options, description=tables.__doc__)
    for name in DOCUMENTS:
        path = ROOT / name
        old, new = path.read_text(), document(name)
        if old != new:
            path.write_text(new)
        print(f"{name}: {'unchanged' if old == new else 'written'}")


if __name__ == "__main__":
    main()
