"""Numbers in the text and the JSON of labels, checked."""

import math
import sys
from typing import Any

from graphrl_jax.perception.importers.recording import ImportFailure


def number(value: Any, what: str) -> float:
    """A number of JSON.

    Raises:
      ImportFailure: it is no number, or none that is finite.
    """
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= sys.float_info.max:
        raise ImportFailure(f"{what} is {value!r}; allowed: finite numbers")
    return float(value)


def text_number(text: str | None, what: str) -> float:
    """The number that a text is.

    Raises:
      ImportFailure: the text is missing, no number, or none that is finite.
    """
    try:
        value = float(text or "")
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ImportFailure(f"{what} is {'missing' if text is None else repr(text)}; allowed: finite numbers")
    return value


def whole(value: float, what: str, low: int = 0, high: int | None = None) -> int:
    """A whole number from `low` to `high`.

    Raises:
      ImportFailure: it is another one.
    """
    if not float(value).is_integer() or value < low or (high is not None and value > high):
        upper = "" if high is None else f" to {high}"
        raise ImportFailure(f"{what} is {value:.10g}; allowed: whole numbers from {low}{upper}")
    return int(value)
