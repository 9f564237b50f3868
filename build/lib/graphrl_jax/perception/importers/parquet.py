"""Reader of parquet files: columns of plain values, and one value at a time of large columns."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pyarrow
from pyarrow.parquet import ParquetFile

from graphrl_jax.perception.importers.recording import ImportFailure

_ROWS_AT_ONCE = 16
"""Rows of a large column in memory at a time."""


def read_columns(path: Path, required: Sequence[str], optional: Sequence[str] = ()) -> dict[str, list[Any]]:
    """Columns of a file by name; optional ones only if the file has them.

    Raises:
      ImportFailure: the file is missing or damaged, or lacks a required column.
    """
    with _opened(path, required) as file:
        names = [*required, *(name for name in optional if name in file.schema_arrow.names)]
        table = file.read(columns=names)
        return {name: table.column(name).to_pylist() for name in names}


def stream_column(path: Path, name: str) -> Iterator[Any]:
    """Yields the values of one column, in the order of the rows.

    Raises:
      ImportFailure: the file is missing or damaged, or lacks the column.
    """
    with _opened(path, [name]) as file:
        for batch in file.iter_batches(batch_size=_ROWS_AT_ONCE, columns=[name]):
            yield from batch.column(name)


@contextmanager
def _opened(path: Path, required: Sequence[str]) -> Iterator[ParquetFile]:
    if not path.is_file():
        raise ImportFailure(f"{path} is missing")
    try:
        with ParquetFile(path) as file:
            for name in required:
                if name not in file.schema_arrow.names:
                    raise ImportFailure(f"{path}: column {name} is missing; allowed: {', '.join(required)} and others")
            yield file
    except ImportFailure:
        raise
    except (pyarrow.ArrowException, OSError, ValueError, KeyError) as error:
        raise ImportFailure(f"{path}: no parquet that can be read: {' '.join(str(error).split())}") from None
