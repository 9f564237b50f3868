"""Pages: one HTML file each that opens without a network, images included."""

import base64
import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jinja2
import numpy as np
from PIL import Image

from graphrl_jax.storage import write_atomically

IMAGES, IMAGE_WIDTH = 6, 240
"""Frames shown per recording, and their width in pixels."""
_WIDTH, _HEIGHT = 800, 204
_LEFT, _RIGHT, _TOP, _BOTTOM = 52, 784, 12, 172
_TEMPLATES = jinja2.Environment(
    loader=jinja2.PackageLoader("graphrl_jax.viz"), autoescape=True, undefined=jinja2.StrictUndefined
)


@dataclass(frozen=True)
class Scored:
    """A recording on a page of scores.

    Attributes:
      name: of the recording.
      summary: see `reward.scoring.summary`, and `episode_index`.
      progress: (T,) progress in every frame.
      frame_rate: frames per second.
      frames: (`IMAGES`, H, W, 3) uint8, some frames, evenly spread; None without images.
    """

    name: str
    summary: dict[str, Any]
    progress: np.ndarray
    frame_rate: float
    frames: np.ndarray | None = None


def spread(frames: np.ndarray | None) -> np.ndarray | None:
    """`IMAGES` frames of a recording (T, H, W, 3), evenly spread from the first to the last."""
    return None if frames is None else frames[_shown(len(frames))]


def _shown(length: int) -> np.ndarray:
    return np.linspace(0, length - 1, IMAGES).round().astype(int)


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
    text = _TEMPLATES.get_template("score.html").render(
        title=title,
        demonstrations=demonstrations,
        source=source,
        end_reward=end_reward,
        recordings=[_context(one) for one in recordings],
        levels=[(_y(level), f"{level:g}") for level in (0.0, 0.5, 1.0)],
        **{"width": _WIDTH, "height": _HEIGHT, "left": _LEFT, "right": _RIGHT, "top": _TOP, "bottom": _BOTTOM},
    )
    write_atomically(path, lambda temporary: temporary.write_text(text, encoding="utf-8"))


def _context(one: Scored) -> dict[str, Any]:
    """What the template needs of a recording."""
    last = max(len(one.progress) - 1, 1)
    seconds = last / one.frame_rate

    def x(second: float) -> float:
        return round(_LEFT + (_RIGHT - _LEFT) * min(second / seconds, 1.0), 1)

    points = " ".join(f"{x(n / one.frame_rate)},{_y(float(value))}" for n, value in enumerate(one.progress))
    stalls = [(x(first), round(x(end) - x(first), 1)) for first, end in one.summary["stalls"]]
    step = _tick(seconds)
    ticks = [(x(tick), f"{tick:g}") for tick in np.arange(0, seconds + 1e-9, step)]
    subtasks = [x(frame / one.frame_rate) for frame in one.summary["subtasks"]]
    images = (
        []
        if one.frames is None
        else [
            {"seconds": number / one.frame_rate, "data": _jpeg(frame)}
            for number, frame in zip(_shown(len(one.progress)), one.frames, strict=True)
        ]
    )
    plot = {"points": points, "stalls": stalls, "ticks": ticks, "subtasks": subtasks}
    return {**one.summary, "name": one.name, "images": images, "plot": plot}


def _y(progress: float) -> float:
    return round(_BOTTOM - (_BOTTOM - _TOP) * progress, 1)


def _tick(seconds: float) -> float:
    """A round distance of ticks, of which there are at most eight."""
    rounds = (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 30, 60, 120, 300, 600, 1800, 3600)
    return next((step for step in rounds if seconds / step <= 8), seconds / 8)


def _jpeg(frame: np.ndarray) -> str:
    """A frame as base64 of a small JPEG."""
    image = Image.fromarray(frame)
    image.thumbnail((IMAGE_WIDTH, IMAGE_WIDTH))
    file = io.BytesIO()
    image.save(file, "JPEG", quality=80)
    return base64.b64encode(file.getvalue()).decode()
