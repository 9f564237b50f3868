"""What the benchmarks' figures share. Matplotlib's figure objects alone: no display is needed."""

import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path

import imageio.v3 as imageio
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from graphrl_jax.experiment.run_directory import Run
from graphrl_jax.storage import write_atomically


def plain(axes: Axes) -> None:
    """Takes away the frame's upper and right line."""
    axes.spines[["top", "right"]].set_visible(False)


def save(figure: Figure, path: Path) -> None:
    """Writes a PNG, whole or not at all."""
    write_atomically(path, FigureCanvasAgg(figure).print_png)


def learning_curves(runs: Sequence[Path], labels: Mapping[str, str], path: Path) -> None:
    """Measures of policy training over steps, a line per run; measures that a run lacks are left out.

    Args:
      runs: folders.
      labels: label of the axis, by measure.
      path: of the figure.
    """
    draw_curves({run.name: Run(run).records("ppo") for run in runs}, labels, path)


def draw_curves(records: Mapping[str, Sequence[Mapping[str, float]]], labels: Mapping[str, str], path: Path) -> None:
    """As `learning_curves`, of log lines by the name of their run, METHOD_SEED; a colour per method."""
    methods = list(dict.fromkeys(run.rpartition("_")[0] for run in records))
    shown = [name for name in labels if all(name in lines[-1] for lines in records.values())]
    figure = Figure(figsize=(4 * len(shown) + 1.6, 3.4), dpi=120, layout="constrained")
    for axes, name in zip(figure.subplots(1, len(shown), squeeze=False)[0], shown, strict=True):
        for run, lines in records.items():
            method = run.rpartition("_")[0]
            steps, values = [line["env_steps"] / 1e6 for line in lines], [line[name] for line in lines]
            axes.plot(steps, values, color=f"C{methods.index(method)}", label=method)
        axes.set(xlabel="environment steps (millions)", ylabel=labels[name])
        if name in ("success", "score"):
            axes.set_ylim(-0.02, 1.02)
        plain(axes)
    named = dict(zip(*reversed(figure.axes[0].get_legend_handles_labels()), strict=True))
    figure.legend(named.values(), named, loc="outside right upper", frameon=False, fontsize=8)
    save(figure, path)


def film(run: Path, frames: Sequence[int], path: Path) -> None:
    """Copies a run's video, and puts frames of its first episode side by side in a PNG, the scene alone.

    Args:
      run: folder.
      frames: their numbers.
      path: of both files, without suffix.
    """
    video = run / "rollout.mp4"
    images = imageio.imread(video)
    scenes = np.concatenate([images[frame, :, : images.shape[2] // 2] for frame in frames], axis=1)
    write_atomically(path.with_suffix(".png"), lambda temporary: imageio.imwrite(temporary, scenes))
    write_atomically(path.with_suffix(".mp4"), lambda temporary: shutil.copyfile(video, temporary))
