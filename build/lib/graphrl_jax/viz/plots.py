"""Figures of a run (learning curve, reward over time, reward landscape) and of a sweep (outcomes).

Figures use matplotlib's figure objects only, without global state or a display. Files are written atomically.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from graphrl_jax.reward.landscape import GridReport, LandscapeReport
from graphrl_jax.reward.statistics import interval
from graphrl_jax.storage import write_atomically

DPI = 120
LEARNED_COLOUR, ENVIRONMENT_COLOUR = "tab:green", "tab:blue"
SUCCESS_COLOUR, SCORE_COLOUR = "tab:green", "tab:orange"
EVENT_COLOURS = ("tab:orange", "tab:blue", "tab:red", "tab:purple", "tab:brown", "tab:pink", "tab:olive", "tab:cyan")


def learning_curve(records: Sequence[dict[str, Any]], path: str | Path) -> None:
    """Plots success and score (left), learned and environmental reward (right) over environment steps.

    Args:
      records: lines of `metrics.jsonl` with `env_steps` and any of `success`, `score` (0 to 1), `learned_reward`,
        `env_reward` (mean per step). Records with a missing, null or non-finite value are left out.
      path: the PNG file.
    """
    figure = Figure(figsize=(11, 4), dpi=DPI)
    outcome, reward = figure.subplots(1, 2)
    outcome.set(title="Outcome of finished episodes", ylabel="mean", ylim=(-0.02, 1.02))
    reward.set(title="Reward per step")
    for axes in (outcome, reward):
        axes.set_xlabel("environment steps")
        _plain(axes)

    for name, colour in (("success", SUCCESS_COLOUR), ("score", SCORE_COLOUR)):
        steps, values = _series(records, name)
        if len(values):
            outcome.plot(steps, values, color=colour, label=name)
    if outcome.lines:
        outcome.legend(loc="best", frameon=False)

    rewards = (("learned_reward", "learned", LEARNED_COLOUR), ("env_reward", "environmental", ENVIRONMENT_COLOUR))
    axes = reward
    for name, label, colour in rewards:
        steps, values = _series(records, name)
        if not len(values):
            continue
        if axes.lines:
            # The two rewards have different scales, so the second gets an axis of its own.
            axes = reward.twinx()
            axes.spines["top"].set_visible(False)
        axes.plot(steps, values, color=colour, linestyle="-" if axes is reward else "--")
        axes.set_ylabel(f"{label} reward", color=colour)
        axes.tick_params(axis="y", labelcolor=colour)
    _save(figure, path)


def reward_over_time(
    rewards: np.ndarray,
    lengths: np.ndarray,
    events: np.ndarray,
    event_names: Sequence[str],
    frame_rate: float,
    path: str | Path,
    title: str,
) -> None:
    """Plots the reward along episodes, one line per episode, with marks at true events.

    Args:
      rewards: (B, T) float.
      lengths: (B,) int, frames of each episode.
      events: (B, E) int, frame at which each event happened, -1 for never.
      event_names: (E,).
      frame_rate: frames per second.
      path: the PNG file.
      title: title of the figure.
    """
    figure = Figure(figsize=(9, 4.5), dpi=DPI)
    axes = figure.subplots()
    axes.set(title=title, xlabel="time (s)", ylabel="reward")
    _plain(axes)
    for episode, length in zip(rewards, lengths, strict=True):
        axes.plot(np.arange(length) / frame_rate, episode[:length], color="0.55", linewidth=0.8, alpha=0.7, zorder=1)
    for index, name in enumerate(event_names):
        frames = events[:, index]
        happened = np.flatnonzero((frames >= 0) & (frames < lengths))
        axes.scatter(
            frames[happened] / frame_rate,
            rewards[happened, frames[happened]],
            marker="|",
            # Later events in the list have shorter marks, so that coinciding events stay visible.
            s=160 * (len(event_names) - index),
            linewidths=1.8,
            color=EVENT_COLOURS[index % len(EVENT_COLOURS)],
            label=f"{name.replace('_', ' ')} ({len(happened)} of {len(rewards)})",
            zorder=2,
        )
    if len(event_names):
        axes.legend(loc="best", title="true events")
    _save(figure, path)


def landscape(report: LandscapeReport, path: str | Path) -> None:
    """Plots one heat map per grid of an audit: the reward as one object is moved over the arena.

    The goal is outlined, a circle marks the object's start, a star the largest reward: green inside the goal, else red.
    """
    number = max(len(report.grids), 1)
    figure = Figure(figsize=(4.3 * number, 4.2), dpi=DPI)
    panels = np.ravel(figure.subplots(1, number, squeeze=False))
    for axes, grid in zip(panels, report.grids, strict=False):
        _heat_map(figure, axes, grid)
    figure.suptitle("Learned reward as one object is moved (star: maximum, green if inside the goal; circle: start)")
    _save(figure, path)


def sweep(rows: Sequence[dict[str, Any]], field: str, path: str | Path) -> None:
    """Plots success of policies (left) and landscape metrics of their rewards (right) against a swept float.

    Args:
      rows: `swept` (values by field), and `success_rate` or `encoder` (an audit's metrics) if available. Dots are
        members, lines are means over members with the same value, bars are 95 % intervals.
      field: the swept field on the x-axis.
      path: the PNG file.
    """
    figure = Figure(figsize=(11, 4), dpi=DPI)
    outcome, scenes = figure.subplots(1, 2)
    outcome.set(title="Success of the policies", ylim=(-0.02, 1.02))
    scenes.set(title="Landscape of the reward, shares")
    shares = (("pair_accuracy", "pairs of random scenes in order"), ("finished_above_unfinished", "finished first"))
    _against(outcome, field, [(row["swept"][field], row["success_rate"]) for row in rows if "success_rate" in row])
    for name, label in shares:
        pairs = [(row["swept"][field], row["encoder"][name]) for row in rows if "encoder" in row]
        _against(scenes, field, pairs, label)
    if scenes.lines:
        scenes.legend(loc="best", frameon=False)
    _save(figure, path)


def _against(axes: Axes, field: str, pairs: Sequence[tuple[float, float]], label: str | None = None) -> None:
    """Plots values over a swept float: members, means and intervals."""
    _plain(axes)
    axes.set_xlabel(field)
    if not pairs:
        return
    values = sorted({value for value, _ in pairs})
    if values[0] > 0 and values[-1] >= 10 * values[0]:
        axes.set_xscale("log")
    found = [[result for value, result in pairs if value == wanted] for wanted in values]
    means = [float(np.mean(results)) for results in found]
    spreads = [interval(results) or [mean, mean] for results, mean in zip(found, means, strict=True)]
    # An interval clipped to [0, 1] may miss the mean by a rounding error.
    reach = [(max(mean - low, 0.0), max(high - mean, 0.0)) for mean, (low, high) in zip(means, spreads, strict=True)]
    bars = axes.errorbar(values, means, yerr=np.transpose(reach), marker="o", capsize=3, label=label)
    axes.scatter(*zip(*pairs, strict=True), s=12, alpha=0.5, color=bars.lines[0].get_color())


def _heat_map(figure: Figure, axes: Axes, grid: GridReport) -> None:
    mesh = axes.pcolormesh(grid.x, grid.y, grid.values, cmap="viridis", shading="nearest")
    bar = figure.colorbar(mesh, ax=axes, fraction=0.046, pad=0.03)
    bar.ax.tick_params(labelsize=9)
    axes.fill(*grid.goal_outline.T, fill=False, edgecolor="white", linewidth=2, linestyle="--")
    axes.plot(*grid.start, marker="o", color="white", markeredgecolor="black", markersize=9)
    colour = "limegreen" if grid.maximum_inside else "red"
    axes.plot(*grid.maximum, marker="*", color=colour, markeredgecolor="black", markersize=18)
    axes.set(title=grid.name, xlabel="x", ylabel="y", aspect="equal")


def _series(records: Sequence[dict[str, Any]], name: str) -> tuple[np.ndarray, np.ndarray]:
    """Environment steps and values (M,) of the records with a finite value of this name."""
    pairs = [(record["env_steps"], record[name]) for record in records if record.get(name) is not None]
    steps, values = np.array(pairs, np.float64).reshape(-1, 2).T
    finite = np.isfinite(values)
    return steps[finite], values[finite]


def _plain(axes: Axes) -> None:
    axes.grid(alpha=0.3)
    axes.spines[["top", "right"]].set_visible(False)


def _save(figure: Figure, path: str | Path) -> None:
    FigureCanvasAgg(figure)
    figure.tight_layout()
    write_atomically(Path(path), lambda temporary: figure.savefig(temporary, format="png"))
