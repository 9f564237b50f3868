"""Numbers as people read them: shares in percent, counts with separators, durations.

Values come from a run's JSON files, where null stands for a value that is not finite; it becomes a dash. Texts are
plain; `typeset` is for pages.
"""

import math
import re
from collections.abc import Sequence
from typing import TypeGuard

NONE = "-"
_UNITS = (("G", 1e9), ("M", 1e6), ("k", 1e3))
_LEAST_SHORT = 10_000
_MINUTE, _ROUGHLY, _HOUR = 60, 600, 3600


def percent(share: float | None) -> str:
    """A share such as 0.9961 as `99.6 %`; only 1 is `100 %`, and only 0 is `0 %`."""
    if not _known(share):
        return NONE
    text = f"{100 * share:.1f}"
    if text in ("100.0", "0.0") and share not in (0, 1):
        return "> 99.9 %" if share > 0.5 else "< 0.1 %"
    return f"{text.removesuffix('.0')} %"


def decimal(value: float | None) -> str:
    """A number with two decimals; with none from 100 on, and with one digit if two decimals would show none."""
    if not _known(value):
        return NONE
    size = abs(value)
    return f"{value:,.0f}" if size >= 100 else f"{value:.2f}" if size >= 0.005 or not size else f"{value:.1g}"


def short(value: float | None) -> str:
    """A number as a short label, such as `4.1 M` or `0.05`; whole numbers below 10,000 are written out."""
    if not _known(value):
        return NONE
    if value == round(value) and abs(value) < _LEAST_SHORT:
        return count(value)
    for unit, size in _UNITS:
        if abs(value) >= size:
            return f"{value / size:.3g} {unit}"
    return f"{value:.3g}"


def labels(numbers: Sequence[float], step: float) -> list[str]:
    """Labels of numbers on an axis, all with the same unit and the same decimals.

    Args:
      numbers: the numbers.
      step: distance between them; 1, 2 or 5 times a power of ten.
    """
    largest = max(map(abs, numbers), default=0.0)
    unit, size = next(((f" {unit}", size) for unit, size in _UNITS if largest >= max(size, _LEAST_SHORT)), ("", 1.0))
    digits = max(0, -math.floor(math.log10(step / size) + 1e-9))
    return [f"{number / size:,.{digits}f}{unit}" if number else "0" for number in numbers]


def count(number: float | None) -> str:
    """A whole number with separators, such as `4,096,000`."""
    return f"{number:,.0f}" if _known(number) else NONE


def duration(seconds: float | None) -> str:
    """Seconds such as 82.7 as `1 min 23 s`; from ten minutes on, whole minutes."""
    if not _known(seconds):
        return NONE
    if seconds < _MINUTE:
        return f"{seconds:.1f} s"
    if seconds < _ROUGHLY:
        return f"{round(seconds) // 60} min {round(seconds) % 60} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if seconds < _HOUR else f"{minutes // 60} h {minutes % 60} min"


def listed(names: Sequence[str]) -> str:
    """Names as a sentence lists them: `a`, `a and b`, `a, b and c`."""
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)


def typeset(text: str) -> str:
    """The same text with minus signs, and with no break between a number and its unit."""
    text = re.sub(r"(?<![\w.])-(?=\d)", "−", text)
    return re.sub(r"(?<=\d) (?=(?:%|[GMk]|s|min|h)(?!\w))", "\u00a0", text)


def _known(value: float | None) -> TypeGuard[float]:
    return isinstance(value, int | float) and math.isfinite(value)
