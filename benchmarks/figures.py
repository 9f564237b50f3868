"""What the benchmarks' figures share. Matplotlib's figure objects alone: no display is needed."""

from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from graphrl_jax.storage import write_atomically


def plain(axes: Axes) -> None:
    """Takes away the frame's upper and right line."""
    axes.spines[["top", "right"]].set_visible(False)


def save(figure: Figure, path: Path) -> None:
    """Writes a PNG, whole or not at all."""
    write_atomically(path, FigureCanvasAgg(figure).print_png)
