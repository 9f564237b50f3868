"""The tables of README.md and docs/results.md, written from the committed result files.

    python -m benchmarks.tables

No number in them is typed by hand; a test fails if the documents and the result files disagree. `documents.py` says
which document has which tables; text outside the markers is left alone.
"""

from benchmarks.tables.documents import DOCUMENTS, document, with_tables
from benchmarks.tables.markers import BEGIN, END

__all__ = ["BEGIN", "DOCUMENTS", "END", "document", "with_tables"]
