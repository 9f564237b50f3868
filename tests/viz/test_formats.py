"""Numbers as they are read, by hand."""

import pytest

from graphrl_jax.viz.formats import NONE, count, decimal, duration, labels, listed, percent, short, typeset


@pytest.mark.parametrize(
    "text, expected",
    [
        (percent(255 / 256), "99.6 %"), (percent(0.5), "50 %"), (percent(1.0), "100 %"), (percent(0.0), "0 %"),
        (percent(0.9999), "> 99.9 %"), (percent(1e-5), "< 0.1 %"),
        (decimal(-54.585), "-54.59"), (decimal(1466.8), "1,467"), (decimal(0.0), "0.00"), (decimal(0.00123), "0.001"),
        (short(10_240_000), "10.2 M"), (short(163_840), "164 k"), (short(2048), "2,048"), (short(0.05), "0.05"),
        (count(4_096_000), "4,096,000"),
        (duration(12.34), "12.3 s"), (duration(268.0), "4 min 28 s"), (duration(1698.7), "28 min"),
        (duration(9999), "2 h 47 min"),
        (listed(["a"]), "a"), (listed(["a", "b", "c"]), "a, b and c"),
    ],
)  # fmt: skip
def test_a_number_is_short_and_says_no_more_than_is_true(text, expected):
    assert text == expected


@pytest.mark.parametrize("form", [percent, decimal, short, count, duration])
@pytest.mark.parametrize("value", [None, float("nan"), float("inf"), "many"])
def test_what_is_no_number_is_a_dash(form, value):
    assert form(value) == NONE


def test_labels_of_an_axis_agree_in_unit_and_decimals():
    assert labels([0.0, 5000.0, 10_000.0], 5000.0) == ["0", "5 k", "10 k"]
    assert labels([0.0, 5e5, 1e6], 5e5) == ["0", "0.5 M", "1.0 M"]
    assert labels([0.0, 500.0, 1000.0], 500.0) == ["0", "500", "1,000"]
    assert labels([-0.74, -0.72, -0.7], 0.02) == ["-0.74", "-0.72", "-0.70"]


def test_a_page_sets_minus_signs_and_keeps_units_with_their_numbers():
    assert typeset("from -0.75 to 12.5 % of 4 min 28 s") == "from −0.75 to 12.5\u00a0% of 4\u00a0min 28\u00a0s"
    assert typeset("held-out, 2 successes, run-3") == "held-out, 2 successes, run-3"
