"""Names come apart into words, numbers and hashes."""

from fractions import Fraction
from pathlib import PurePath

import pytest

from graphrl_jax.perception.importers.names import read_names


def taken_apart(*stems, timed=True):
    return read_names([PurePath(f"{stem}.png") for stem in stems], timed)


@pytest.mark.parametrize(
    "stem, words, numbers, kinds",
    [
        ("Frame_(07) left", "frame#left", [7], ["frame"]),
        ("shot.1.0002", "shot##", [1, 2], ["count", "count"]),
        ("t=12.50s", "t#s", [Fraction(25, 2)], ["time"]),
        ("v1.2.3", "v###", [1, 2, 3], ["count"] * 3),
        ("640x480", "#x#", [640, 480], ["count", "count"]),
    ],
)
def test_words_and_numbers(stem, words, numbers, kinds):
    (name,) = taken_apart(stem)
    assert (name.words, list(name.numbers), list(name.kinds)) == (words, numbers, kinds)


def test_dates_and_clock_times_are_seconds():
    early, late, later = taken_apart("2024-01-01_10.15.00", "20240101T101501.500", "20240102")
    assert [name.kinds for name in (early, late, later)] == [("time",)] * 3
    assert late.numbers[0] - early.numbers[0] == Fraction(3, 2)
    assert later.numbers[0] - early.numbers[0] == 13 * 3600 + 45 * 60
    assert taken_apart("10-15-00")[0].numbers == (36900,)
    assert taken_apart("20241399")[0].kinds == ("count",)


def test_without_times_all_numbers_are_integers():
    (name,) = taken_apart("20240101_12.5", timed=False)
    assert name.numbers == (20240101, 12, 5)


def test_hashes_are_no_numbers():
    for stem, hashes in (("7c3f9e12_3", ("7c3f9e12",)), ("3.rf.9f8e7d6c5b4a", ("9f8e7d6c5b4a",)), ("face0003", ())):
        (name,) = taken_apart(stem)
        assert name.numbers == (3,) and tuple(filter(None, name.hashes)) == hashes
