"""A detector by colour and shape, for drawn scenes; it has no weights."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from graphrl_jax.perception.detector import Detection, box_of_corners

RGB = tuple[int, int, int]
SPECK = 3e-4
"""Smallest part of an object of several parts, as a share of the frame; smaller parts are specks."""


@dataclass(frozen=True)
class Look:
    """Appearance of a class: flat colours with an outline, as in a drawing.

    Attributes:
      class_id: the class.
      fill: colours of the inside.
      outline: colours of the surrounding line, which belongs to the object.
      reach: distance of the shape's farthest point from its middle, in radii of the disc of equal area (1 for a disc,
        1.25 for a square). It distinguishes classes that share their colours. With None, everything of these colours
        is one object, such as a robot of several parts.
    """

    class_id: int
    fill: tuple[RGB, ...]
    outline: tuple[RGB, ...] = ()
    reach: float | None = None


class ColourDetector:
    """Finds objects by colour and classifies them by shape; it has no weights.

    Objects that touch are separated by the outlines between them. The box of a partly hidden object covers its visible
    part only.

    Args:
      looks: appearance of the classes. Classes that share their colours must all have a `reach`.
      margin: width of the ignored border, as a share of the frame's side.
      smallest: least area of an object with a `reach`, as a share of the frame.
      line: largest width of an outline around a fill, as a share of the frame's side.
      tolerance: largest Euclidean distance of a pixel from a colour, in grey levels; videos change colours a little.

    Raises:
      ValueError: classes share their colours and one has no `reach`, or they share only some colours.
    """

    def __init__(
        self,
        looks: Sequence[Look],
        margin: float = 0.0,
        smallest: float = 0.002,
        line: float = 0.016,
        tolerance: float = 14.0,
    ) -> None:
        self.margin, self.smallest, self.line = margin, smallest, line
        self._groups: dict[tuple[RGB, ...], list[Look]] = {}
        for look in looks:
            self._groups.setdefault(look.fill, []).append(look)
        for fill, group in self._groups.items():
            if len(group) > 1 and any(look.reach is None for look in group):
                raise ValueError(
                    f"classes {[look.class_id for look in group]} share the colours {fill}: reach is missing"
                )
        # Colours to codes, at 5 bits per channel: 2 k + 1 for the fill of group k, 2 k + 2 for its outline, else 0.
        codes: dict[RGB, int] = {}
        for number, (fill, group) in enumerate(self._groups.items()):
            outline = dict.fromkeys(colour for look in group for colour in look.outline)
            for colour, code in [*((c, 2 * number + 1) for c in fill), *((c, 2 * number + 2) for c in outline)]:
                if codes.setdefault(colour, code) != code:
                    raise ValueError(f"the colour {colour} belongs to two looks that differ in others")
        cells = np.stack(np.meshgrid(*[np.arange(4, 256, 8)] * 3, indexing="ij"), -1).reshape(-1, 3)
        distances = np.linalg.norm(cells[:, None] - np.array(list(codes)), axis=-1)
        nearest = np.array(list(codes.values()), np.uint8)[distances.argmin(1)]
        self._codes = np.where(distances.min(1) <= tolerance, nearest, 0).astype(np.uint8)

    def detect(self, frame: np.ndarray) -> list[Detection]:
        """See `Detector.detect`."""
        codes = self._codes[_packed(frame)]
        height, width = codes.shape
        rim = math.ceil(self.margin * max(height, width))
        codes = codes[rim : height - rim, rim : width - rim]
        found = []
        for number, group in enumerate(self._groups.values()):
            code = 2 * number + 1
            if group[0].reach is None:
                parts = (codes == code) | (codes == code + 1) if group[0].outline else codes == code
                whole = _whole(parts, SPECK * height * width)
                found += [] if whole is None else [(group[0].class_id, whole)]
            else:
                found += self._shapes(codes, code, group, self.smallest * height * width, self.line * width)
        size = np.array([width, height, width, height], np.float32)
        return [Detection(class_id, box_of_corners(corners + rim) / size) for class_id, corners in found]

    def _shapes(
        self, codes: np.ndarray, code: int, group: list[Look], smallest: float, line: float
    ) -> list[tuple[int, np.ndarray]]:
        """Class and corners of every object of one colour: connected fills, each with the outline around it."""
        fills = codes == code
        extent = _extent(fills)
        if extent is None:
            return []
        left, top = extent[0], extent[1]
        labels = np.zeros((extent[3] - top, extent[2] - left), np.int32)
        ndimage.label(fills[top : extent[3], left : extent[2]], output=labels)
        areas = np.bincount(labels.ravel())[1:]
        large = np.append(False, areas >= smallest)
        reach, found = math.ceil(line), []
        for label, (rows, columns) in enumerate(ndimage.find_objects(labels), start=1):
            if not large[label]:
                continue
            inside = np.pad(labels[rows, columns] == label, reach)
            corner = rows.start - reach, columns.start - reach
            around = _window(codes, top + corner[0], left + corner[1], inside.shape)
            near = ndimage.maximum_filter(inside.view(np.uint8), size=2 * reach + 1).view(bool)
            others = large[_window(labels, *corner, inside.shape)] & ~inside
            if others.any():  # a line between two objects is divided between them
                near &= ndimage.distance_transform_edt(~inside) <= ndimage.distance_transform_edt(~others)
            corners = _extent(inside | (near & (around == code + 1)))
            assert corners is not None
            offset = np.array([left + corner[1], top + corner[0]] * 2)
            found.append((_closest(group, inside).class_id, corners + offset))
        return found


def _closest(group: list[Look], shape: np.ndarray) -> Look:
    """The class whose `reach` is nearest to that of a shape (H, W) bool."""
    if len(group) == 1:
        return group[0]
    rows, columns = np.nonzero(shape)
    farthest = np.hypot(rows - rows.mean(), columns - columns.mean()).max()
    reach = farthest / math.sqrt(len(rows) / math.pi)
    return min(group, key=lambda look: abs(look.reach - reach))


def _packed(colours: np.ndarray) -> np.ndarray:
    """Colours (..., 3) uint8 as (...) uint16, five bits per channel."""
    packed = np.left_shift(colours[..., 0] & 0xF8, 7, dtype=np.uint16)
    packed |= np.left_shift(colours[..., 1] & 0xF8, 2, dtype=np.uint16)
    packed |= colours[..., 2] >> 3
    return packed


def _whole(mask: np.ndarray, least: float) -> np.ndarray | None:
    """`_extent` of the connected parts of at least `least` pixels, because compression leaves specks at edges."""
    extent = _extent(mask)
    if extent is None:
        return None
    labels = np.zeros((extent[3] - extent[1], extent[2] - extent[0]), np.int32)
    ndimage.label(mask[extent[1] : extent[3], extent[0] : extent[2]], output=labels)
    large = np.bincount(labels.ravel()) >= least
    large[0] = False
    within = _extent(large[labels])
    return None if within is None else within + np.tile(extent[:2], 2)


def _extent(mask: np.ndarray) -> np.ndarray | None:
    """Corners x0, y0, x1, y1 (4,) around the True pixels of a mask (H, W); None if there are none."""
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    if not len(rows):
        return None
    return np.array([columns[0], rows[0], columns[-1] + 1, rows[-1] + 1])


def _window(codes: np.ndarray, top: int, left: int, shape: tuple[int, ...]) -> np.ndarray:
    """The window of `codes` of this shape at (top, left), 0 beyond the border."""
    window = np.zeros(shape, codes.dtype)
    rows = slice(max(top, 0), min(top + shape[0], codes.shape[0]))
    columns = slice(max(left, 0), min(left + shape[1], codes.shape[1]))
    window[rows.start - top : rows.stop - top, columns.start - left : columns.stop - left] = codes[rows, columns]
    return window
