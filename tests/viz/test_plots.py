"""Figures: written, of a sensible size, and not blank, whatever is missing from the input."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from graphrl_jax.reward.landscape import GridReport, LandscapeReport
from graphrl_jax.viz import plots


def assert_figure(path: Path, least_width: int = 600) -> np.ndarray:
    """Pixels of a PNG that shows something and left nothing else in its folder."""
    with Image.open(path) as image:
        assert image.format == "PNG"
        assert least_width <= image.width <= 4000 and 300 <= image.height <= 2000
        pixels = np.asarray(image.convert("RGB"))
    assert len(np.unique(pixels.reshape(-1, 3), axis=0)) > 20
    assert list(path.parent.iterdir()) == [path]
    return pixels


def count(pixels: np.ndarray, colour: tuple[int, int, int]) -> int:
    return int(np.sum(np.all(pixels == colour, axis=-1)))


@pytest.mark.parametrize(
    "names",
    [("success", "score", "learned_reward", "env_reward"), ("success", "env_reward"), ()],
)
def test_learning_curve_draws_what_there_is(tmp_path: Path, names: tuple[str, ...]) -> None:
    records = [{"env_steps": 1000 * i, **{name: 0.1 * i for name in names}} for i in range(8)]
    records += [{"env_steps": 9000, "success": None, "score": float("nan")}, {"env_steps": 10000}]
    path = tmp_path / "figures" / "learning_curve.png"
    plots.learning_curve(records, path)
    assert_figure(path)


def test_learning_curve_without_records(tmp_path: Path) -> None:
    plots.learning_curve([], tmp_path / "empty.png")
    assert_figure(tmp_path / "empty.png")


def test_reward_over_time_marks_events_that_happened(tmp_path: Path) -> None:
    rewards = np.linspace(-1.0, 0.0, 30)[None] * np.ones((3, 1))
    lengths, names = np.array([30, 20, 30]), ("star_placed", "square_placed")
    orange = (255, 127, 14)

    def draw(folder: str, events: np.ndarray) -> int:
        path = tmp_path / folder / "rewards.png"
        plots.reward_over_time(rewards, lengths, events, names, 8.0, path, "Held-out demonstrations")
        return count(assert_figure(path), orange)

    never = np.full((3, 2), -1)
    with_event = never.copy()
    with_event[0, 0] = 25
    behind_the_end = never.copy()
    behind_the_end[1, 0] = 25
    assert draw("with", with_event) > draw("without", never) == draw("behind", behind_the_end)


def report(inside: bool) -> LandscapeReport:
    x, y = np.linspace(-1, 1, 12), np.linspace(-1, 1, 9)
    values = -np.hypot(x[None] - 0.4, y[:, None] - 0.3)
    region = np.array([[0.1, 0.0], [0.7, 0.0], [0.7, 0.7], [0.1, 0.7]])
    maximum = np.array([0.4, 0.3]) if inside else np.array([-0.8, -0.8])
    grid = GridReport("star, square at goal", values, x, y, region, np.array([0.8, -0.7]), maximum, inside)
    return LandscapeReport((grid, grid), 0.9, 1.0, float(inside), 1.0, 0.0)


def test_landscape_star_is_green_inside_and_red_outside(tmp_path: Path) -> None:
    limegreen, red = (50, 205, 50), (255, 0, 0)
    for inside, colour, other in ((True, limegreen, red), (False, red, limegreen)):
        path = tmp_path / str(inside) / "landscape.png"
        plots.landscape(report(inside), path)
        pixels = assert_figure(path)
        assert count(pixels, colour) > 50 and count(pixels, other) == 0


def test_a_sweep_is_drawn_with_whatever_its_members_have_got(tmp_path: Path) -> None:
    encoder = {"pair_accuracy": 0.9, "finished_above_unfinished": 1.0}
    rows = [{"swept": {"alpha": value}, "success_rate": 0.03 * value} for value in (1.0, 4.0, 16.0) for _ in range(2)]
    rows = [rows[0], *({**row, "encoder": encoder} for row in rows[1:])]
    plots.sweep(rows, "alpha", tmp_path / "whole" / "sweep.png")
    plots.sweep([{"swept": {"alpha": 1.0}}], "alpha", tmp_path / "none" / "sweep.png")
    whole, none = (assert_figure(tmp_path / name / "sweep.png") for name in ("whole", "none"))
    assert np.any(whole != none)
