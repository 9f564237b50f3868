"""Trackers: what TensorBoard's files hold, and what the other packages are asked to do."""

import importlib.machinery
import re
import sys
import tomllib
import types
from pathlib import Path

import numpy as np
import PIL.Image
import pytest

from graphrl_jax.experiment.trackers import TRACKERS, tracker_named
from graphrl_jax.viz.video import write_video
from tests.helpers.events import logged
from tests.helpers.outside_package import REPOSITORY


@pytest.fixture
def folder(tmp_path):
    """The folder of a run."""
    (tmp_path / "run").mkdir()
    return tmp_path / "run"


@pytest.fixture
def media(tmp_path):
    """An image and a video."""
    PIL.Image.new("RGB", (3, 2), "red").save(tmp_path / "curve.png")
    write_video(np.zeros((6, 8, 8, 3), np.uint8), tmp_path / "rollout.mp4", 20)
    return tmp_path / "curve.png", tmp_path / "rollout.mp4"


@pytest.fixture
def stub(monkeypatch):
    """Makes a package that notes how it is called; `init` gives a run that does so, too."""

    class Noted:
        def __init__(self, calls: list, name: str):
            self._calls, self._name = calls, name

        def __getattr__(self, name: str):
            return lambda *given, **named: self._calls.append((f"{self._name}.{name}", *given, named))

    def make(name: str) -> list:
        calls: list = []
        package, notes = types.ModuleType(name), Noted(calls, name)
        package.__spec__ = importlib.machinery.ModuleSpec(name, None, origin="stub")
        for function in ("log", "finish"):
            setattr(package, function, getattr(notes, function))
        package.init = lambda **named: calls.append(("init", named)) or Noted(calls, "run")
        package.Image = lambda *given: ("Image", *given)
        package.Video = lambda *given, **named: ("Video", *given, named)
        monkeypatch.setitem(sys.modules, name, package)
        return calls

    return make


def track(name: str, folder: Path, media: tuple[Path, Path], complete: bool = True) -> None:
    """A whole run under a tracker."""
    image, video = media
    tracker = tracker_named(name)
    tracker.start(folder, "abc", {"seed": 3})
    tracker.scalars({"policy/success": 0.5, "policy/update": 2}, 1024)
    tracker.image("figures/curve", image, 2048)
    tracker.video("videos/rollout", video, 2048)
    tracker.finish(complete)


def test_tensorboard_holds_what_was_logged(folder, media):
    track("tensorboard", folder, media)
    text, *numbers, image, video = logged(folder / "tensorboard")
    assert text[1] == "config/text_summary" and '"seed": 3' in text[2]
    assert numbers == [(1024, "policy/success", 0.5), (1024, "policy/update", 2.0)]
    assert image == (2048, "figures/curve", media[0].read_bytes())
    # As a GIF: 0.3 s at 10 frames a second. TensorBoard shows no mp4.
    assert video[:2] == (2048, "videos/rollout") and video[2][:4] == b"GIF8"


def test_tensorboard_goes_on_in_the_same_folder_after_a_run_was_killed(folder):
    for number in range(2):
        tracker = tracker_named("tensorboard")
        tracker.start(folder, "abc", {})
        tracker.scalars({"policy/success": float(number)}, 10 * number)
        # All of it is on disk, although the tracker was not finished.
        found = [(step, value) for step, tag, value in logged(folder / "tensorboard") if tag == "policy/success"]
        assert found == [(0, 0.0), (10, 1.0)][: number + 1]


@pytest.mark.parametrize("complete, exit_code", [(True, 0), (False, 1)])
def test_wandb_is_asked_to_resume_and_never_for_a_step_that_falls(
    folder, monkeypatch, media, stub, complete, exit_code
):
    monkeypatch.delenv("WANDB_PROJECT", raising=False)
    calls = stub("wandb")
    track("wandb", folder, media, complete)
    started = {"project": "graphrl", "id": "abc", "name": "run", "dir": str(folder), "resume": "allow"}
    image, video = map(str, media)
    assert calls == [
        ("init", {**started, "config": {"seed": 3}}),
        ("run.define_metric", "*", {"step_metric": "step"}),
        ("run.log", {"policy/success": 0.5, "policy/update": 2, "step": 1024}, {}),
        ("run.log", {"figures/curve": ("Image", image), "step": 2048}, {}),
        ("run.log", {"videos/rollout": ("Video", video, {}), "step": 2048}, {}),
        ("run.finish", {"exit_code": exit_code}),
    ]


def test_wandb_takes_the_project_of_the_environment(folder, monkeypatch, stub):
    monkeypatch.setenv("WANDB_PROJECT", "mine")
    calls = stub("wandb")
    tracker_named("wandb").start(folder, "abc", {})
    assert calls[0][1]["project"] == "mine"


def test_trackio_gets_a_name_that_no_other_run_has(folder, media, stub):
    calls = stub("trackio")
    track("trackio", folder, media)
    image, video = map(str, media)
    assert calls == [
        ("init", {"project": "graphrl", "name": "run-abc", "config": {"seed": 3}, "resume": "allow"}),
        ("trackio.log", {"policy/success": 0.5, "policy/update": 2}, {"step": 1024}),
        ("trackio.log", {"figures/curve": ("Image", image)}, {"step": 2048}),
        ("trackio.log", {"videos/rollout": ("Video", video, {})}, {"step": 2048}),
        ("trackio.finish", {}),
    ]


def test_an_unknown_tracker_is_refused_with_those_that_exist():
    with pytest.raises(ValueError, match="unknown tracker 'paper'; allowed: tensorboard, wandb, trackio"):
        tracker_named("paper")


@pytest.mark.parametrize("name", TRACKERS)
def test_a_package_that_is_missing_is_refused_with_its_extra(monkeypatch, tmp_path, name):
    package = TRACKERS[name].package
    message = re.escape(f'--track {name} needs the package {package}: pip install "graphrl_jax[{name}]"')
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(ValueError, match=message):
        tracker_named(name)
    # A folder of that name, such as wandb makes, is no package.
    monkeypatch.delitem(sys.modules, package)
    monkeypatch.setattr(sys, "path", [str(tmp_path)])
    (tmp_path / package).mkdir()
    with pytest.raises(ValueError, match=message):
        tracker_named(name)


@pytest.mark.parametrize("name", TRACKERS)
def test_a_tracker_has_an_extra_of_its_name(name):
    extras = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    (needed,) = extras[name]
    assert re.fullmatch(rf"{TRACKERS[name].package}>=[0-9.]+,<[0-9]+", needed)
