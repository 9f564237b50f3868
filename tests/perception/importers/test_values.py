"""Numbers are finite, and whole where they count; what is not is named."""

import pytest

from graphrl_jax.perception.importers.recording import ImportFailure
from graphrl_jax.perception.importers.values import number, text_number, whole


def test_numbers_come_through():
    assert number(3, "x") == 3.0 and number(-0.5, "x") == -0.5
    assert text_number(" 1.50 ", "x") == 1.5 and text_number("1e2", "x") == 100
    assert whole(4.0, "x") == 4 and whole(0, "x", 0, 0) == 0 and whole(-1, "x", -1) == -1


@pytest.mark.parametrize("value", [True, None, "4", [1], {}, float("nan"), float("inf"), 10**400])
def test_what_is_no_number_of_json_is_named(value):
    with pytest.raises(ImportFailure, match="width is .*; allowed: finite numbers"):
        number(value, "width")


@pytest.mark.parametrize("text", ["", " ", "nan", "-inf", "1,5", "one", "0x10"])
def test_what_is_no_number_in_a_text_is_named(text):
    with pytest.raises(ImportFailure, match=f"xtl is '{text}'; allowed: finite numbers"):
        text_number(text, "xtl")
    with pytest.raises(ImportFailure, match="xtl is missing; allowed: finite numbers"):
        text_number(None, "xtl")


@pytest.mark.parametrize(
    "value, high, says",
    [(1.5, None, "1.5; allowed: whole numbers from 1"), (0, None, "0;"), (1234567, 9, "1234567; allowed: .* 1 to 9")],
)
def test_what_is_not_whole_or_out_of_range_is_named(value, high, says):
    with pytest.raises(ImportFailure, match=f"frame is {says}"):
        whole(value, "frame", 1, high)
