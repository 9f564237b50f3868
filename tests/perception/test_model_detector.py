"""Trained models are asked in their own language."""

import importlib.util
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from graphrl_jax.perception.model_detector import ModelDetector, ultralytics
from tests.helpers.graphs import OBJECTS

FRAME = np.zeros((100, 200, 3), np.uint8)


def test_a_model_with_ultralytics_interface():
    boxes = SimpleNamespace(
        xywhn=np.array([[0.5, 0.5, 0.1, 0.2], [0.2, 0.2, 0.1, 0.1], [0.1, 0.1, 0.1, 0.1]]),
        cls=np.array([7.0, 7.0, 3.0]),
        conf=np.array([0.9, 0.2, 0.9]),
    )

    def model(frame):
        assert frame is FRAME
        return [SimpleNamespace(boxes=boxes)]

    model.names = {3: "cat", 7: "shoe"}
    (detection,) = ModelDetector(model, ("box", "shoe")).detect(FRAME)
    assert detection.class_id == 1
    np.testing.assert_allclose(detection.box, [0.5, 0.5, 0.1, 0.2])
    with pytest.raises(ValueError, match=r"the model knows \['cat', 'shoe'\], but the task has \('robot',\)"):
        ModelDetector(model, ("robot",))


def test_a_model_with_torchvisions_interface():
    result = {"boxes": np.array([[20.0, 10.0, 60.0, 30.0]]), "labels": np.array([1]), "scores": np.array([0.8])}
    detector = ModelDetector(lambda image: [result], ("box", "shoe"), names={1: "box"}, prepare=lambda frame: [frame])
    (detection,) = detector.detect(FRAME)
    assert (detection.class_id, detection.confidence) == (0, 0.8)
    np.testing.assert_allclose(detection.box, [0.2, 0.2, 0.2, 0.2])


@pytest.mark.skipif(importlib.util.find_spec("ultralytics") is not None, reason="ultralytics is installed")
def test_ultralytics_is_asked_for_by_name(tmp_path):
    with pytest.raises(ValueError, match="need the package ultralytics"):
        ultralytics(tmp_path / "weights.pt", OBJECTS)


def test_ultralytics_models_see_blue_green_red(monkeypatch, tmp_path):
    asked = []

    def model(frame):
        asked.append(frame)
        return [SimpleNamespace(boxes=SimpleNamespace(xywhn=np.zeros((0, 4)), cls=np.zeros(0), conf=np.zeros(0)))]

    model.names = {0: "block"}
    monkeypatch.setitem(sys.modules, "ultralytics", SimpleNamespace(YOLO=lambda weights: model))
    frame = np.random.default_rng(0).integers(0, 256, (4, 6, 3), dtype=np.uint8)
    assert ultralytics(tmp_path / "weights.pt", OBJECTS).detect(frame) == []
    np.testing.assert_array_equal(asked[0], frame[..., ::-1])
