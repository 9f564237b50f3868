"""Pages: one HTML file each that opens without a network, images included. What all of them share: files and plots.

The templates extend `base.html`, which has the style, and draw with the macros of `plots.html`.
"""

import base64
import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jinja2
import numpy as np
from PIL import Image

from graphrl_jax.storage import write_atomically
from graphrl_jax.viz import formats

WIDTH, HALF_WIDTH, HEIGHT = 960, 520, 240
"""Sizes of plots in their own units: across the page, two side by side."""
FRAMES, FRAME_WIDTH = 6, 240
"""Frames shown of a recording, and their width in pixels."""
MOST_POINTS = 400
"""A line with more points is drawn with so many of them, evenly spread."""
LEVELS = ((0.0, "0"), (0.5, "0.5"), (1.0, "1"))
"""Ticks of a share."""
_LEFT, _RIGHT, _TOP, _BOTTOM = 52, 16, 12, 32
_MOST_STEPS = 6
_SECONDS = (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 30, 60, 120, 300, 600, 1800, 3600)
_KINDS = {".png": "image/png", ".mp4": "video/mp4"}
_TEMPLATES = jinja2.Environment(
    loader=jinja2.PackageLoader("graphrl_jax.viz"),
    autoescape=True,
    undefined=jinja2.StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)
_TEMPLATES.filters |= {
    one.__name__: one for one in (formats.percent, formats.decimal, formats.duration, formats.typeset)
}


@dataclass(frozen=True)
class Line:
    """A line of a plot.

    Attributes:
      x: (M,) places from left to right.
      y: (M,) heights.
      style: classes of the style sheet, such as `first` or `second thin`.
      title: what is told of the line under the pointer.
    """

    x: np.ndarray
    y: np.ndarray
    style: str = "first"
    title: str = ""


@dataclass(frozen=True)
class Plot:
    """Lines over an axis that begins at 0, all in units of the data.

    Attributes:
      label: what it shows, for those who cannot see it.
      last: right end of the axis, above 0.
      low, high: lower and upper end of the heights.
      lines: the lines.
      x_ticks, y_ticks: places and labels.
      bands: (from, to) of shaded stretches.
      marks: places of dashed vertical lines.
      levels: heights of dashed horizontal lines.
      dots: (x, y, style, title) of points.
      width, height: of the plot in its own units.
    """

    label: str
    last: float
    low: float
    high: float
    lines: Sequence[Line]
    x_ticks: Sequence[tuple[float, str]]
    y_ticks: Sequence[tuple[float, str]]
    bands: Sequence[tuple[float, float]] = ()
    marks: Sequence[float] = ()
    levels: Sequence[float] = ()
    dots: Sequence[tuple[float, float, str, str]] = ()
    width: int = WIDTH
    height: int = HEIGHT

    @property
    def left(self) -> int:
        """Left end of the axis in the plot's own units; so are `right`, `top` and `bottom`."""
        return _LEFT

    @property
    def right(self) -> int:
        return self.width - _RIGHT

    @property
    def top(self) -> int:
        return _TOP

    @property
    def bottom(self) -> int:
        return self.height - _BOTTOM

    def x(self, place: float) -> float:
        """A place on the axis in the plot's own units."""
        share = min(max(place / self.last, 0.0), 1.0)
        return round(self.left + (self.right - self.left) * share, 1)

    def y(self, height: float) -> float:
        """A height in the plot's own units."""
        share = (height - self.low) / (self.high - self.low)
        return round(self.bottom - (self.bottom - self.top) * min(max(share, 0.0), 1.0), 1)

    def points(self, line: Line) -> str:
        """A line's points as SVG takes them; those that are not finite are left out."""
        finite = np.flatnonzero(np.isfinite(line.x) & np.isfinite(line.y))
        kept = finite[np.linspace(0, len(finite) - 1, min(len(finite), MOST_POINTS)).round().astype(int)]
        places = zip(line.x[kept].tolist(), line.y[kept].tolist(), strict=True)
        return " ".join(f"{self.x(x)},{self.y(y)}" for x, y in places)


def progress_plot(label: str, seconds: float, lines: Sequence[Line], width: int = WIDTH, **marked: Any) -> Plot:
    """The plot of progress, 0 to 1, over some seconds; `marked` are bands, marks or levels."""
    return Plot(label, seconds, 0.0, 1.0, lines, seconds_ticks(seconds, width), LEVELS, width=width, **marked)


def seconds_ticks(seconds: float, width: int = WIDTH) -> list[tuple[float, str]]:
    """Round times from 0 on."""
    most = 8 if width == WIDTH else 5
    step = next((step for step in _SECONDS if seconds / step <= most), seconds / most)
    return [(float(tick), f"{tick:g}") for tick in np.arange(0, seconds + 1e-9, step)]


def number_ticks(low: float, high: float) -> list[tuple[float, str]]:
    """A few round numbers between two."""
    rough = (high - low) / _MOST_STEPS
    size = 10.0 ** math.floor(math.log10(rough))
    step = next(factor * size for factor in (1, 2, 5, 10) if factor * size >= rough * (1 - 1e-9))
    numbers = [number * step for number in range(math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9) + 1)]
    return list(zip(numbers, formats.labels(numbers, step), strict=True))


def power_ticks(low: float, high: float) -> list[tuple[float, str]]:
    """Round numbers on a logarithmic axis between two powers of ten; heights are the powers."""
    factors = (1,) if high - low > 1.5 else (1, 2, 5)
    numbers = [factor * 10.0**power for power in range(math.floor(low), math.ceil(high) + 1) for factor in factors]
    return [(math.log10(one), formats.short(float(f"{one:.1g}"))) for one in numbers if low <= math.log10(one) <= high]


def write_page(path: Path, template: str, **context: Any) -> None:
    """Writes a page, atomically."""
    text = _TEMPLATES.get_template(template).render(**context)
    write_atomically(path, lambda temporary: temporary.write_text(text, encoding="utf-8"))


def spread(frames: np.ndarray | None) -> np.ndarray | None:
    """`FRAMES` frames of a recording (T, H, W, 3), evenly spread from the first to the last."""
    return None if frames is None else frames[shown_frames(len(frames))]


def shown_frames(length: int) -> np.ndarray:
    """Numbers of the frames that `spread` shows."""
    return np.linspace(0, length - 1, FRAMES).round().astype(int)


def jpeg(frame: np.ndarray, width: int = FRAME_WIDTH) -> str:
    """A frame (H, W, 3) uint8 as the address of a small JPEG inside the page."""
    image = Image.fromarray(frame)
    image.thumbnail((width, width))
    file = io.BytesIO()
    image.save(file, "JPEG", quality=80)
    return _address("image/jpeg", file.getvalue())


def embedded(path: Path) -> str:
    """A .png or .mp4 file as an address inside the page."""
    return _address(_KINDS[path.suffix], path.read_bytes())


def _address(kind: str, content: bytes) -> str:
    return f"data:{kind};base64,{base64.b64encode(content).decode()}"
