"""Trained models are asked in their own language."""

import importlib
import importlib.util
import sys
from dataclasses import replace
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


@pytest.fixture
def weights(tmp_path):
    """A file that is there."""
    path = tmp_path / "weights.pt"
    path.write_bytes(b"no weights")
    return path


def install(monkeypatch, model):
    """Puts a package `ultralytics` in place whose models are `model`."""
    monkeypatch.setitem(sys.modules, "ultralytics", SimpleNamespace(YOLO=lambda weights: model))


@pytest.mark.skipif(importlib.util.find_spec("ultralytics") is not None, reason="ultralytics is installed")
def test_ultralytics_is_asked_for_by_name(weights):
    with pytest.raises(ValueError, match="need the package ultralytics"):
        ultralytics(weights, OBJECTS)


def test_weights_that_are_missing_are_not_looked_for_elsewhere(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "ultralytics", SimpleNamespace(YOLO=pytest.fail))
    with pytest.raises(ValueError, match=r"yolo11n\.pt is missing$"):
        ultralytics(tmp_path / "yolo11n.pt", OBJECTS)


def test_ultralytics_models_see_blue_green_red_and_are_silent(monkeypatch, weights):
    asked = []

    def model(frame, verbose):
        assert not verbose
        asked.append(frame)
        return [SimpleNamespace(boxes=SimpleNamespace(xywhn=np.zeros((0, 4)), cls=np.zeros(0), conf=np.zeros(0)))]

    model.names, model.task = {0: "block"}, "detect"
    install(monkeypatch, model)
    frame = np.random.default_rng(0).integers(0, 256, (4, 6, 3), dtype=np.uint8)
    assert ultralytics(weights, OBJECTS).detect(frame) == []
    np.testing.assert_array_equal(asked[0], frame[..., ::-1])


def test_models_without_boxes_are_refused(monkeypatch, weights):
    install(monkeypatch, SimpleNamespace(names={0: "block"}, task="classify"))
    with pytest.raises(ValueError, match=r"is a model for classify; allowed: detect, segment, pose$"):
        ultralytics(weights, OBJECTS)


@pytest.fixture
def package(monkeypatch, tmp_path):
    """The real package, which keeps its settings in a folder of the test."""
    if importlib.util.find_spec("ultralytics") is None:
        pytest.skip("ultralytics is not installed")
    monkeypatch.setenv("YOLO_CONFIG_DIR", str(tmp_path))
    monkeypatch.setenv("YOLO_OFFLINE", "true")
    return importlib.import_module("ultralytics")


@pytest.fixture
def untrained(package, tmp_path):
    """Weights of an untrained model of two classes."""
    model = package.YOLO("yolov8n.yaml")
    model.model.names = {0: "block", 1: "cat"}
    model.model.args |= {"imgsz": 64}
    model.save(tmp_path / "untrained.pt")
    return tmp_path / "untrained.pt"


def test_a_real_model_gets_red_green_blue_and_prints_nothing(untrained, capfd):
    torch = importlib.import_module("torch")
    seen = []

    def look(module, inputs):
        image = inputs[0] if isinstance(inputs[0], torch.Tensor) else None
        if image is not None and image.ndim == 4 and image.shape[1] == 3:
            seen.append(image[0].mean((1, 2)).tolist())

    detector = ultralytics(untrained, OBJECTS)
    capfd.readouterr()
    hook = torch.nn.modules.module.register_module_forward_pre_hook(look)
    try:
        assert detector.detect(np.full((64, 64, 3), (255, 102, 0), np.uint8)) == []
    finally:
        hook.remove()
    assert seen[-1] == pytest.approx([1.0, 0.4, 0.0], abs=1e-3)
    assert "".join(capfd.readouterr()) == ""


def test_a_file_without_a_model_is_refused_in_one_sentence(package, weights):
    with pytest.raises(ValueError, match=r"weights\.pt holds no Ultralytics model: ") as refusal:
        ultralytics(weights, OBJECTS)
    assert "\n" not in str(refusal.value)


def test_a_real_model_of_other_classes_is_refused(untrained):
    others = replace(OBJECTS, class_names=tuple(f"other {name}" for name in OBJECTS.class_names))
    with pytest.raises(ValueError, match=r"the model knows \['block', 'cat'\], but the task has"):
        ultralytics(untrained, others)
