"""The page of `graphrl score`: a ranking of recordings, and the curve of each."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from graphrl_jax.viz.page import Line, jpeg, progress_plot, shown_frames, write_page


@dataclass(frozen=True)
class Scored:
    """A recording on a page of scores.

    Attributes:
      name: of the recording.
      summary: see `reward.scoring.summary`, and `episode_index`.
      progress: (T,) progress in every frame.
      frame_rate: frames per second.
      frames: (`page.FRAMES`, H, W, 3) uint8, some frames, evenly spread; None without images.
    """

    name: str
    summary: dict[str, Any]
    progress: np.ndarray
    frame_rate: float
    frames: np.ndarray | None = None


def scores_page(
    path: Path, recordings: Sequence[Scored], title: str, demonstrations: int, source: str, end_reward: float
) -> None:
    """Writes the page of scored recordings, in their order.

    Args:
      path: the HTML file.
      recordings: the recordings.
      title: of the page.
      demonstrations, source, end_reward: of the reward model; see `Card`.
    """
    write_page(
        path,
        "score.html",
        title=title,
        demonstrations=demonstrations,
        source=source,
        end_progress=1 + end_reward,
        recordings=[_context(one) for one in recordings],
    )


def _context(one: Scored) -> dict[str, Any]:
    """What the template needs of a recording."""
    times = np.arange(len(one.progress)) / one.frame_rate
    plot = progress_plot(
        "progress over time",
        max(len(one.progress) - 1, 1) / one.frame_rate,
        [Line(times, one.progress)],
        bands=one.summary["stalls"],
        marks=[frame / one.frame_rate for frame in one.summary["subtasks"]],
    )
    frames = [] if one.frames is None else zip(shown_frames(len(one.progress)), one.frames, strict=True)
    images = [(number / one.frame_rate, jpeg(frame)) for number, frame in frames]
    return {**one.summary, "name": one.name, "images": images, "plot": plot}
