"""File names taken apart into words, numbers and hashes."""

import re
from collections.abc import Sequence
from fractions import Fraction
from pathlib import PurePath
from typing import Literal, NamedTuple

Kind = Literal["frame", "count", "time"]
"""A number after the word "frame", another integer, and a date, clock time or decimal number."""


class Name(NamedTuple):
    """A file name taken apart.

    Attributes:
      path: the whole name.
      words: its letters, with # for every number; hashes are left out.
      numbers: its numbers, times in seconds.
      kinds: kind of each number.
      hashes: its hashes, such as the prefixes of Label Studio.
    """

    path: PurePath
    words: str
    numbers: tuple[Fraction, ...]
    kinds: tuple[Kind, ...]
    hashes: tuple[str, ...]


_HASH = (
    r"(?<![a-z0-9])(?:[0-9a-f]{8}(?:-[0-9a-f]{4}){3}-[0-9a-f]{12}"
    # A word such as face0001 changes once between letters and digits, a hash more often.
    r"|(?=[0-9a-f]*[0-9][a-f])(?=[0-9a-f]*[a-f][0-9])[0-9a-f]{8,})(?![a-z0-9])"
)
# A minus after a letter or a digit separates.
_MINUS = "(?<![a-z0-9)])-(?=[0-9])"
_INTEGER = f"(?:{_MINUS})?[0-9]+"
_DECIMAL = r"(?<![0-9.])[0-9]+\.[0-9]+(?![0-9.])"
_DATE = r"(?:19|20)[0-9]{2}(?P<d>[-_.]?)(?:0[1-9]|1[0-2])(?P=d)(?:0[1-9]|[12][0-9]|3[01])"
_FRACTION = r"(?:[-_.,]?(?:[0-9]{9}|[0-9]{6}|[0-9]{3}))?"
_HOUR, _SIXTY = "(?:[01][0-9]|2[0-3])", "[0-5][0-9]"
_DATED = rf"{_DATE}(?:[-_ t.]?{_HOUR}(?P<c>[-_.:]?){_SIXTY}(?P=c){_SIXTY}{_FRACTION})?"
_CLOCK = rf"{_HOUR}(?P<e>[-_.:]){_SIXTY}(?P=e){_SIXTY}{_FRACTION}"
_TIMED = re.compile(
    rf"(?P<hash>{_HASH})|(?<![0-9])(?:(?P<date>{_DATED})|(?P<clock>{_CLOCK}))(?![0-9])"
    rf"|(?P<decimal>{_DECIMAL})|(?P<integer>{_INTEGER})"
)
_COUNTED = re.compile(rf"(?P<hash>{_HASH})|(?P<integer>{_INTEGER})")
_PREFIX = re.compile("([0-9a-f]{8})-(?=.)")


def read_names(paths: Sequence[PurePath], timed: bool) -> list[Name]:
    """The names of files of one folder, taken apart.

    Args:
      paths: the files; folders and endings are ignored.
      timed: whether digits that can be a date, a clock time or a decimal number are one, or integers one by one.
    """
    stems = [path.stem.casefold() for path in paths]
    stems = _decimal(stems) if _hexadecimal(stems) else stems
    if all(re.search(_MINUS, stem) for stem in stems):
        stems = [re.sub(_MINUS, "_", stem) for stem in stems]
    prefixes = [_PREFIX.match(stem) for stem in stems]
    # Some of many random prefixes look like numbers or words.
    hashed = all(prefixes) and any(re.search(f"^{_HASH}", stem) for stem in stems)
    names = []
    for path, stem, prefix in zip(paths, stems, prefixes, strict=True):
        cut = prefix.end() if prefix and hashed else 0
        name = _taken_apart(path, stem[cut:], _TIMED if timed else _COUNTED)
        names.append(name._replace(hashes=(stem[:cut], *name.hashes)))
    return names


def _taken_apart(path: PurePath, stem: str, pattern: re.Pattern[str]) -> Name:
    words, end = "", 0
    numbers: list[Fraction] = []
    kinds: list[Kind] = []
    hashes: list[str] = []
    for token in pattern.finditer(stem):
        words += _letters(stem[end : token.start()])
        end = token.end()
        if token.lastgroup == "hash":
            hashes.append(token[0])
            continue
        exact = token.lastgroup == "integer"
        numbers.append(Fraction(token[0]) if exact or token.lastgroup == "decimal" else _seconds(token))
        kinds.append(("frame" if re.search("frames?$", words) else "count") if exact else "time")
        words += "#"
    return Name(path, words + _letters(stem[end:]), tuple(numbers), tuple(kinds), tuple(hashes))


def _letters(text: str) -> str:
    """Text without what separates words."""
    return re.sub(r"[\W_]+", "", text)


def _seconds(token: re.Match[str]) -> Fraction:
    """Seconds of a date or a clock time, from any origin; all months count 31 days."""
    digits = re.sub("[^0-9]", "", token[0])
    digits = digits.ljust(14, "0") if token["date"] else "0" * 8 + digits
    year, parts = int(digits[:4]), [int(digits[at : at + 2]) for at in range(4, 14, 2)]
    total = year
    for part, size in zip(parts, (12, 31, 24, 60, 60), strict=True):
        total = total * size + part
    return total + Fraction(f"0.{digits[14:]}0")


def _hexadecimal(stems: Sequence[str]) -> bool:
    """Whether names of one beginning end in hexadecimal numbers of one width, as in 09, 0a."""
    tails = [match[0] if (match := re.search("(?<![0-9a-z])[0-9a-f]{2,}$", stem)) else "" for stem in stems]
    heads = {stem[: len(stem) - len(tail)] for stem, tail in zip(stems, tails, strict=True)}
    values = sorted(int(tail or "0", 16) for tail in tails)
    counted = all(after - before in (1, 2) for before, after in zip(values[:-1], values[1:], strict=True))
    digits = [tail.isdecimal() for tail in tails]
    return len(heads) == len(set(map(len, tails))) == 1 and counted and any(digits) and not all(digits)


def _decimal(stems: Sequence[str]) -> list[str]:
    """The names with their hexadecimal ends as decimal numbers."""
    return [re.sub("[0-9a-f]{2,}$", lambda end: str(int(end[0], 16)), stem) for stem in stems]
