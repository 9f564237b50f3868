"""Adapters from trained models to detectors."""

import os
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from graphrl_jax.graph import ObjectTable
from graphrl_jax.perception.detector import Detection, box_of_corners
from graphrl_jax.runtime import optional_package

_WITH_BOXES = ("detect", "segment", "pose")
"""Tasks of Ultralytics models whose results have upright boxes."""


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

    Weights are a pickle, from which loading may run code. Unless the environment says otherwise (`YOLO_OFFLINE`,
    `YOLO_AUTOINSTALL`), Ultralytics sends no statistics and installs no packages when this is the first to load it.

    Raises:
      ValueError: the package is not installed, there is no such file, it holds no model that finds boxes, or the model
        knows none of the task's classes.
    """
    # Ultralytics looks for a missing file of a well-known name on the network.
    if not weights.exists():
        raise ValueError(f"{weights} is missing")
    model = _yolo(weights)
    if model.task not in _WITH_BOXES:
        raise ValueError(f"{weights} is a model for {model.task}; allowed: {', '.join(_WITH_BOXES)}")
    return ModelDetector(
        partial(model, verbose=False),  # else it prints a line per frame
        objects.class_names,
        names=model.names,
        # Ultralytics expects arrays in BGR order, as OpenCV reads images.
        prepare=lambda frame: np.ascontiguousarray(frame[..., ::-1]),
    )


def _yolo(weights: Path) -> Any:
    """An Ultralytics model from a file."""
    os.environ.setdefault("YOLO_OFFLINE", "true")
    os.environ.setdefault("YOLO_AUTOINSTALL", "false")
    package = optional_package("ultralytics", "detect", "trained detectors need")
    try:
        return package.YOLO(weights)
    except Exception as error:  # of whatever kind, as it unpickles
        raise ValueError(f"{weights} holds no Ultralytics model: {' '.join(str(error).split())}") from None
