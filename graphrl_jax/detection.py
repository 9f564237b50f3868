"""Objects in a picture: what a detector is, one that knows colours and shapes, and adapters for trained models.

A detector sees one frame and says which classes of objects are where. Who is who over time is `tracking`'s affair.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np
from scipy import ndimage

from graphrl_jax.graph import ObjectTable

RGB = tuple[int, int, int]
SPECK = 3e-4
"""Share of the frame below which parts of an object of several parts are specks."""


class Detection(NamedTuple):
    """An object in a frame: its class, and its box (4,) float32, cx, cy, w, h in units of the frame."""

    class_id: int
    box: np.ndarray


class Detector(Protocol):
    """Anything that finds objects in a frame."""

    def detect(self, frame: np.ndarray) -> list[Detection]:
        """Objects in a frame (H, W, 3) uint8, in any order."""
        ...


@dataclass(frozen=True)
class Look:
    """What objects of a class look like: flat colours with an outline, as in a drawing.

    Attributes:
      class_id: the class.
      fill: colours of the inside.
      outline: colours of the line around it, which belongs to the object.
      reach: of a shape: its farthest point's distance from its middle, in radii of the disc of equal area (a disc's
        is 1, a square's 1.25). Tells apart classes that share their colours. None takes everything of these colours as
        one object: a robot of several parts.
    """

    class_id: int
    fill: tuple[RGB, ...]
    outline: tuple[RGB, ...] = ()
    reach: float | None = None


class ColourDetector:
    """Finds objects by colour and tells them apart by shape; no weights.

    Objects that touch are told apart by the outlines between them. An object that something hides in part is as large
    as what is left of it.

    Args:
      looks: what there is to find. Classes that share their colours must all have a `reach`.
      margin: share of the frame's side at its border in which nothing is looked for.
      smallest: share of the frame that an object of known shape covers at least.
      line: share of the frame's side within which an outline is looked for around a fill.
      tolerance: how far a pixel may be from a colour, in grey levels (Euclidean): videos change them a little.

    Raises:
      ValueError: classes share their colours and one has no `reach`, or they share some of them only.
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
        # Colours to codes, at 5 bits a channel: fill of the k-th group 2 k + 1, its outline 2 k + 2, all else 0.
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
        return [Detection(class_id, _centred(corners + rim) / size) for class_id, corners in found]

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
            if others.any():  # a line between two objects is shared out
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
    """Colours (..., 3) uint8 as (...) uint16, five bits a channel."""
    packed = np.left_shift(colours[..., 0] & 0xF8, 7, dtype=np.uint16)
    packed |= np.left_shift(colours[..., 1] & 0xF8, 2, dtype=np.uint16)
    packed |= colours[..., 2] >> 3
    return packed


def _whole(mask: np.ndarray, least: float) -> np.ndarray | None:
    """`_extent` of connected parts of at least `least` pixels: compression leaves specks at edges."""
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
    """Corners x0, y0, x1, y1 (4,) of what is True in a mask (H, W); None if nothing is."""
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    if not len(rows):
        return None
    return np.array([columns[0], rows[0], columns[-1] + 1, rows[-1] + 1])


def _window(codes: np.ndarray, top: int, left: int, shape: tuple[int, ...]) -> np.ndarray:
    """A part of `codes` of this shape, 0 beyond its border."""
    window = np.zeros(shape, codes.dtype)
    rows = slice(max(top, 0), min(top + shape[0], codes.shape[0]))
    columns = slice(max(left, 0), min(left + shape[1], codes.shape[1]))
    window[rows.start - top : rows.stop - top, columns.start - left : columns.stop - left] = codes[rows, columns]
    return window


def _centred(corners: np.ndarray) -> np.ndarray:
    """x0, y0, x1, y1 as cx, cy, w, h: (4,) float32."""
    low, high = corners[:2], corners[2:]
    return np.concatenate([(low + high) / 2, high - low]).astype(np.float32)


class ModelDetector:
    """A trained model as a detector: Ultralytics' interface, or torchvision's.

    Args:
      model: called with one frame. Ultralytics: `model(frame)[0].boxes` has `xywhn`, `cls` and `conf`; classes are
        named by `model.names`. Torchvision: `model([image])[0]` is a mapping with `boxes` (x0, y0, x1, y1 in pixels),
        `labels` and `scores`, for a list of one image (3, H, W) that `prepare` makes of the frame.
      class_names: of the task, in order of their ids.
      names: of the model's classes by their number; `model.names` if left out. Those that the task lacks are ignored.
      confidence: detections below it are ignored.
      prepare: what the model is called with, made of the frame (H, W, 3) uint8.

    Raises:
      ValueError: the model knows none of the task's classes.
    """

    def __init__(
        self,
        model: Any,
        class_names: Sequence[str],
        names: Mapping[int, str] | None = None,
        confidence: float = 0.5,
        prepare: Callable[[np.ndarray], Any] = lambda frame: frame,
    ) -> None:
        known = dict(names if names is not None else model.names)
        self._ids = {number: class_names.index(name) for number, name in known.items() if name in class_names}
        if not self._ids:
            raise ValueError(f"the model knows {sorted(known.values())}, but the task has {tuple(class_names)}")
        self._model, self._confidence, self._prepare = model, confidence, prepare

    def detect(self, frame: np.ndarray) -> list[Detection]:
        """See `Detector.detect`."""
        result = self._model(self._prepare(frame))[0]
        if isinstance(result, Mapping):
            size = np.array([frame.shape[1], frame.shape[0]] * 2, np.float32)
            boxes = [_centred(corners) / size for corners in _numbers(result["boxes"]).reshape(-1, 4)]
            classes, scores = _numbers(result["labels"]), _numbers(result["scores"])
        else:
            boxes = _numbers(result.boxes.xywhn).astype(np.float32).reshape(-1, 4)
            classes, scores = _numbers(result.boxes.cls), _numbers(result.boxes.conf)
        return [
            Detection(self._ids[int(number)], box)
            for box, number, score in zip(boxes, classes, scores, strict=True)
            if score >= self._confidence and int(number) in self._ids
        ]


def _numbers(values: Any) -> np.ndarray:
    """An array, or a tensor of torch's wherever it lives, as an array."""
    for method in ("detach", "cpu"):
        values = getattr(values, method)() if hasattr(values, method) else values
    return np.asarray(values)


def ultralytics(weights: Path, objects: ObjectTable) -> ModelDetector:
    """An Ultralytics model, such as YOLO, whose classes are named as the task's are.

    Raises:
      ValueError: the package is not installed, or the model knows none of the task's classes.
    """
    try:
        from ultralytics import YOLO  # pyright: ignore[reportMissingImports]
    except ImportError:
        raise ValueError('trained detectors need the package ultralytics: pip install "graphrl_jax[detect]"') from None
    # It takes arrays for BGR, as OpenCV reads pictures.
    return ModelDetector(
        YOLO(weights), objects.class_names, prepare=lambda frame: np.ascontiguousarray(frame[..., ::-1])
    )
