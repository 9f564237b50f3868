"""Plots in their own units, ticks, and images inside a page."""

import base64
import io

import numpy as np
import pytest
from PIL import Image

from graphrl_jax.viz.page import (
    HALF_WIDTH,
    MOST_POINTS,
    Line,
    Plot,
    embedded,
    jpeg,
    number_ticks,
    power_ticks,
    seconds_ticks,
    spread,
)


def plot(*lines: Line, last: float = 10.0) -> Plot:
    return Plot("a plot", last, -1.0, 1.0, lines, [], [], width=552, height=244)


def test_points_lie_between_the_ends_of_the_axes():
    # The axis runs from 52 to 536, heights from 212 up to 12.
    one = plot(Line(np.array([0.0, 5.0, 10.0]), np.array([-1.0, 0.0, 1.0])))
    assert one.points(one.lines[0]) == "52.0,212.0 294.0,112.0 536.0,12.0"
    assert (one.x(99.0), one.y(-7.0)) == (536.0, 212.0)


def test_points_that_are_not_finite_are_left_out_and_long_lines_are_thinned():
    gap = Line(np.array([0.0, 5.0, 10.0]), np.array([-1.0, np.nan, 1.0]))
    assert plot().points(gap) == "52.0,212.0 536.0,12.0"
    assert plot().points(Line(np.array([]), np.array([]))) == ""
    many = plot(Line(np.linspace(0, 10, 9000), np.linspace(-1, 1, 9000)))
    points = many.points(many.lines[0]).split()
    assert len(points) == MOST_POINTS and (points[0], points[-1]) == ("52.0,212.0", "536.0,12.0")


@pytest.mark.parametrize(
    "ticks, labels",
    [
        (number_ticks(0.0, 10.24e6), ["0", "2 M", "4 M", "6 M", "8 M", "10 M"]),
        (number_ticks(-0.77, -0.675), ["-0.76", "-0.74", "-0.72", "-0.70", "-0.68"]),
        (number_ticks(-4.0, 3.0), ["-4", "-2", "0", "2"]),
        (power_ticks(-2.2, 0.3), ["0.01", "0.1", "1"]),
        (power_ticks(-0.9, 0.1), ["0.2", "0.5", "1"]),
        (seconds_ticks(6.4), ["0", "1", "2", "3", "4", "5", "6"]),
        (seconds_ticks(6.4, HALF_WIDTH), ["0", "2", "4", "6"]),
        (seconds_ticks(90.0), ["0", "20", "40", "60", "80"]),
    ],
)
def test_ticks_are_round_and_few(ticks, labels):
    assert [label for _, label in ticks] == labels


def test_shown_frames_are_spread_from_the_first_to_the_last():
    frames = np.arange(11)[:, None, None, None] * np.ones((1, 2, 2, 3), int)
    np.testing.assert_array_equal(spread(frames)[:, 0, 0, 0], [0, 2, 4, 6, 8, 10])
    assert spread(None) is None


def test_images_are_inside_the_page(tmp_path):
    kind, _, content = jpeg(np.full((300, 400, 3), 200, np.uint8)).partition(",")
    assert kind == "data:image/jpeg;base64"
    assert Image.open(io.BytesIO(base64.b64decode(content))).size == (240, 180)
    (tmp_path / "a.png").write_bytes(b"image")
    assert embedded(tmp_path / "a.png") == "data:image/png;base64," + base64.b64encode(b"image").decode()
