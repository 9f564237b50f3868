"""Markers in documents, between which a script writes."""

import re

BEGIN, END = "<!-- results: written by a script from result files -->\n", "<!-- end of results -->"
_MARKER = re.compile(r"^<!-- ((?:headline )?results(?: of [^:\n]+)?):.*-->\n", re.MULTILINE)


def names_in(text: str) -> list[str]:
    """What the first markers in a text are called, such as `results of Table I`, in order."""
    return _MARKER.findall(text)


def updated(text: str, tables: str, name: str = "results") -> str:
    """A text with the tables between two markers written anew.

    Args:
      text: a document.
      tables: what goes between the markers.
      name: of the first marker; the second is `END`.

    Raises:
      ValueError: a marker is missing.
    """
    begin = next((found for found in _MARKER.finditer(text) if found[1] == name), None)
    if begin is None:
        raise ValueError(f"the text lacks the marker <!-- {name}: ... -->")
    end = text.find(END, begin.end())
    if end < 0 or _MARKER.search(text, begin.end(), end):
        raise ValueError(f"the text lacks the marker {END} after <!-- {name}: ... -->")
    return f"{text[: begin.end()]}\n{tables}\n{text[end:]}"
