"""The figure of Table I: learning curves on every ground, and how many runs reach how much success."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.figures import plain, save
from benchmarks.rows import ROWS
from benchmarks.statistics import interquartile_mean, profile

_LEVELS = np.linspace(0, 1, 201)
_AXES = {"env_steps": (1e6, "environment steps (millions)"), "seconds": (60, "minutes of PPO")}

Rows = Mapping[str, Sequence[Mapping[str, Any]]]


def table1_figure(grounds: Mapping[str, Rows], path: Path) -> None:
    """Draws it.

    Args:
      grounds: finished members by ground and row.
      path: of the PNG.
    """
    figure = Figure(figsize=(13, 3.4 * len(grounds) + 0.3), dpi=120, layout="constrained")
    panels = figure.subplots(len(grounds), len(_AXES) + 1, squeeze=False, sharey=True)
    for (ground, rows), (*curves, levels) in zip(grounds.items(), panels, strict=True):
        for axes, measure in zip(curves, _AXES, strict=True):
            _curves(axes, rows, measure)
        _profiles(levels, rows)
        curves[0].set_ylabel(f"{ground}: success, training episodes")
        levels.set_ylabel("share of runs with more")
    lines = {name: _line(name) for rows in grounds.values() for name in rows}
    handles = [figure.axes[0].plot([], [], **line)[0] for line in lines.values()]
    figure.legend(handles, lines, loc="outside right upper", frameon=False, fontsize=8)
    save(figure, path)


def _line(name: str) -> dict[str, Any]:
    """A colour per method; the paper's way is dashed."""
    methods = list(dict.fromkeys(row.method for row in ROWS.values()))
    row = ROWS[name]
    return {"color": f"C{methods.index(row.method)}", "linestyle": "--" if row.paper else "-"}


def _curves(axes: Axes, rows: Rows, measure: str) -> None:
    """Interquartile mean of success over steps or minutes, and the range of the runs between the quartiles."""
    unit, label = _AXES[measure]
    for name, runs in rows.items():
        shortest = min(len(run["curve"][measure]) for run in runs)
        x, y = (np.array([run["curve"][key][:shortest] for run in runs]) for key in (measure, "success"))
        x = x.mean(0) / unit
        axes.plot(x, interquartile_mean(y, axis=0), **_line(name))
        axes.fill_between(x, *np.quantile(y, (0.25, 0.75), axis=0), color=_line(name)["color"], alpha=0.15, linewidth=0)
    axes.set(xlabel=label, ylim=(-0.02, 1.02))
    plain(axes)


def _profiles(axes: Axes, rows: Rows) -> None:
    """Performance profiles of success on unseen episodes."""
    for name, runs in rows.items():
        axes.plot(_LEVELS, profile([run["success_rate"] for run in runs], _LEVELS), **_line(name))
    axes.set(xlabel="success, unseen episodes", xlim=(0, 1))
    plain(axes)
