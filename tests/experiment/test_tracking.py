"""Tracking: what a run sends to a tracker, that it goes on, and that no fault of a tracker reaches the run."""

import math

import PIL.Image
import pytest

from graphrl_jax.experiment.run_directory import Run
from graphrl_jax.experiment.settings import compose
from graphrl_jax.experiment.tracking import Tracking, numbers
from graphrl_jax.registry import make_task

pytestmark = pytest.mark.usefixtures("outside_package")
SUMMARY = {"env_steps": 2048, "success_rate": 0.25, "device": "cpu", "resumed": True, "encoder": {"kendall_tau": 0.5}}


class Notebook:
    """A tracker that notes what it is called with, and fails where it is told to."""

    name, package = "notebook", "paper"

    def __init__(self, fails_at: str = ""):
        self.calls, self._fails_at = [], fails_at

    def __getattr__(self, name: str):
        def note(*given: object, **named: object) -> None:
            self.calls.append((name, *given, *named.values()))
            if name == self._fails_at:
                raise OSError("no\nnetwork")

        return note

    def called(self, name: str) -> list[tuple]:
        return [call[1:] for call in self.calls if call[0] == name]


@pytest.fixture
def run(tmp_path):
    """A run that has done nothing yet."""
    return Run.start(tmp_path / "run", compose(make_task("carry"), preset="smoke", seed=3))


def train(run: Run, updates: tuple[int, ...] = (2, 4)) -> None:
    """What a training logs and draws."""
    for step in (10, 20):
        run.log({"stage": "pretrain", "step": step, "loss": 1 / step})
    for update in updates:
        run.log({"stage": "ppo", "update": update, "env_steps": 512 * update, "success": math.nan, "score": 0.5})
    run.figures.mkdir(exist_ok=True)
    for name in ("landscape", "curve"):
        PIL.Image.new("RGB", (3, 2)).save(run.figures / f"{name}.png")
    run.video.write_bytes(b"video")


ENCODER = [
    ({"encoder/step": 10, "encoder/loss": 0.1}, 10),
    ({"encoder/step": 20, "encoder/loss": 0.05}, 20),
]
POLICY = [
    ({"policy/update": 2, "policy/env_steps": 1024, "policy/score": 0.5}, 1024),
    ({"policy/update": 4, "policy/env_steps": 2048, "policy/score": 0.5}, 2048),
]
RESULT = ({"summary/env_steps": 2048, "summary/success_rate": 0.25, "summary/encoder/kendall_tau": 0.5}, 2048)


def test_a_run_is_tracked_from_start_to_end(run):
    tracker = Notebook()
    with Tracking(run, tracker, pytest.fail) as tracking:
        train(run)
        tracking.results(SUMMARY)
    ((folder, _, config),) = tracker.called("start")
    assert folder == run.path.resolve() and config == run.config() and config["seed"] == 3
    assert tracker.called("scalars") == [*ENCODER, *POLICY, RESULT]
    assert tracker.called("image") == [
        ("figures/curve", run.figures / "curve.png", 2048),
        ("figures/landscape", run.figures / "landscape.png", 2048),
    ]
    assert tracker.called("video") == [("videos/rollout", run.video, 2048)]
    assert tracker.calls[-1] == ("finish", True)
    before = list(tracker.calls)
    run.log({"stage": "ppo", "update": 6, "env_steps": 3072})
    assert tracker.calls == before


def test_a_resumed_run_goes_on_and_repeats_nothing(run):
    first, second = Notebook(), Notebook()
    with pytest.raises(KeyboardInterrupt), Tracking(run, first, pytest.fail):
        train(run)
        raise KeyboardInterrupt
    assert first.calls[-1] == ("finish", False)
    # The checkpoint was of update 2, so update 4 is made again.
    run.forget_after("ppo", "update", 2)
    run = Run(run.path)
    with Tracking(run, second, pytest.fail) as tracking:
        train(run, updates=(4, 6))
        tracking.results(SUMMARY | {"env_steps": 3072})
    assert first.called("start") == second.called("start")
    assert [step for _, step in second.called("scalars")] == [3072, 3072]


def test_a_run_that_was_not_tracked_is_tracked_afterwards_and_once(run):
    train(run)
    for calls in ([*ENCODER, *POLICY, RESULT], []):
        tracker = Notebook()
        with Tracking(run, tracker, pytest.fail) as tracking:
            tracking.results(SUMMARY)
        assert tracker.called("scalars") == calls and bool(tracker.calls) == bool(calls)


def test_no_tracker_leaves_no_trace(run):
    before = set(run.path.iterdir())
    with Tracking(run, None, pytest.fail) as tracking:
        run.log({"stage": "ppo", "update": 2, "env_steps": 1024})
        tracking.results(SUMMARY)
    assert set(run.path.iterdir()) - before == {run.path / "metrics.jsonl"}


@pytest.mark.parametrize("method", ["start", "scalars", "image", "video", "finish"])
def test_a_tracker_that_fails_costs_one_warning_and_is_left_alone(run, method):
    tracker, warnings = Notebook(fails_at=method), []
    with Tracking(run, tracker, warnings.append) as tracking:
        train(run)
        tracking.results(SUMMARY)
    assert warnings == ["warning: notebook failed and tracks this run no longer: OSError: no network"]
    assert tracker.calls[-1][0] == method and len(tracker.called(method)) == 1
    assert len(run.records("pretrain")) == len(run.records("ppo")) == 2


def test_a_damaged_note_of_what_was_tracked_costs_one_warning(run):
    tracker, warnings = Notebook(), []
    (run.path / "notebook").mkdir()
    (run.path / "notebook" / "tracked.json").write_text("{")
    with Tracking(run, tracker, warnings.append):
        train(run)
    assert len(warnings) == 1 and "tracked.json cannot be read as JSON" in warnings[0] and not tracker.calls


def test_numbers_are_what_is_finite():
    record = {"stage": "ppo", "a": 1, "b": math.inf, "c": None, "d": True, "e": [1.0], "f": {"g": 0.5, "h": {"i": 2}}}
    assert numbers(record, "policy") == {"policy/a": 1, "policy/f/g": 0.5, "policy/f/h/i": 2}
