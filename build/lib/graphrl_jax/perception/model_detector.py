"""Adapters from trained models to detectors."""

import importlib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from graphrl_jax.graph import ObjectTable
from graphrl_jax.perception.detector import Detection, box_of_corners


class ModelDetector:
    """A detector from a trained model with the interface of Ultralytics or of torchvision.

    Args:
      model: called with one frame. Ultralytics: `model(frame)[0].boxes` has `xywhn`, `cls` and `conf`; classes are
        named by `model.names`. Torchvision: `model([image])[0]` is a mapping with `boxes` (x0, y0, x1, y1 in pixels),
        `labels` and `scores`; `prepare` then makes a list of one image (3, H, W) from the frame.
      class_names: class names of the task, in order of their ids.
      names: names of the model's classes by number; default: `model.names`. Classes that the task lacks are ignored.
      confidence: detections below this confidence are ignored.
      prepare: converts a frame (H, W, 3) uint8 to the model's input.

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
            boxes = [box_of_corners(corners) / size for corners in _numbers(result["boxes"]).reshape(-1, 4)]
            classes, scores = _numbers(result["labels"]), _numbers(result["scores"])
        else:
            boxes = _numbers(result.boxes.xywhn).astype(np.float32).reshape(-1, 4)
            classes, scores = _numbers(result.boxes.cls), _numbers(result.boxes.conf)
        return [
            Detection(self._ids[int(number)], box, float(score))
            for box, number, score in zip(boxes, classes, scores, strict=True)
            if score >= self._confidence and int(number) in self._ids
        ]


def _numbers(values: Any) -> np.ndarray:
    """An array, or a torch tensor on any device, as an array."""
    for method in ("detach", "cpu"):
        values = getattr(values, method)() if hasattr(values, method) else values
    return np.asarray(values)


def ultralytics(weights: Path, objects: ObjectTable) -> ModelDetector:
    """A detector from an Ultralytics model, such as YOLO, with the task's class names.

    Raises:
      ValueError: the package is not installed, or the model knows none of the task's classes.
    """
    try:
        ultralytics_package = importlib.import_module("ultralytics")
    except ImportError:
        raise ValueError('trained detectors need the package ultralytics: pip install "graphrl_jax[detect]"') from None
    # Ultralytics expects arrays in BGR order, as OpenCV reads images.
    return ModelDetector(
        ultralytics_package.YOLO(weights),
        objects.class_names,
        prepare=lambda frame: np.ascontiguousarray(frame[..., ::-1]),
    )
