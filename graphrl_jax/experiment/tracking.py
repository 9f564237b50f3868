"""What a run sends to an experiment tracker: its log lines, its figures, its video and its summary."""

import math
import uuid
from collections.abc import Callable, Mapping
from types import TracebackType
from typing import Any

from graphrl_jax.experiment.run_directory import Run
from graphrl_jax.experiment.trackers import Tracker
from graphrl_jax.storage import read_json, write_json

SECTIONS = {"pretrain": ("encoder", "step"), "ppo": ("policy", "env_steps")}
"""By stage of a log line: the section of its metrics, and the field that is their step."""
SUMMARY = "summary"
"""Section of the run's final metrics, which come last."""


class Tracking:
    """Context manager that tracks a run. A tracker that fails is switched off, with one warning; the run goes on.

    `RUN/TRACKER/tracked.json` holds the tracker's id of the run, and the last step of each section. So a resumed run
    goes on where the tracker stopped, and what was logged before it was tracked is sent as well.

    Args:
      run: the run.
      tracker: the tracker; None tracks nothing.
      warn: prints a line.
    """

    def __init__(self, run: Run, tracker: Tracker | None, warn: Callable[[str], None]):
        self._run, self._tracker, self._warn = run, tracker, warn
        self._kept: dict[str, Any] = {"id": uuid.uuid4().hex[:8], "steps": {}}

    def __enter__(self) -> "Tracking":
        self._try(self._start)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._try(lambda tracker: tracker.finish(complete=kind is None))
        self._run.on_log = None

    def results(self, summary: Mapping[str, Any]) -> None:
        """Sends the figures and the video that the run has written, and the numbers of its summary."""
        self._try(lambda tracker: self._send_results(tracker, summary))

    def _try(self, act: Callable[[Tracker], None]) -> None:
        """Acts on the tracker, if there is one; switches it off if it fails, whatever it raises."""
        if self._tracker is None:
            return
        try:
            act(self._tracker)
        except Exception as error:
            name, self._tracker = self._tracker.name, None
            said = " ".join(str(error).split())
            self._warn(f"warning: {name} failed and tracks this run no longer: {type(error).__name__}: {said}")

    def _start(self, tracker: Tracker) -> None:
        file = self._run.path / tracker.name / "tracked.json"
        if file.exists():
            self._kept = read_json(file)
        if SUMMARY in self._kept["steps"]:  # all is tracked already
            self._tracker = None
            return
        tracker.start(self._run.path.resolve(), self._kept["id"], self._run.config())
        for stage in SECTIONS:
            for record in self._run.records(stage):
                self._send_record(tracker, record)
        self._keep(tracker)
        self._run.on_log = self._log

    def _log(self, record: Mapping[str, Any]) -> None:
        """Sends a line of the log."""
        self._try(lambda tracker: self._send_record(tracker, record))
        self._try(self._keep)

    def _send_record(self, tracker: Tracker, record: Mapping[str, Any]) -> None:
        section, field = SECTIONS[record["stage"]]
        self._send(tracker, section, record, int(record[field]))

    def _send_results(self, tracker: Tracker, summary: Mapping[str, Any]) -> None:
        step = int(summary["env_steps"])
        for path in sorted(self._run.figures.glob("*.png")):
            tracker.image(f"figures/{path.stem}", path, step)
        if self._run.video.exists():
            tracker.video(f"videos/{self._run.video.stem}", self._run.video, step)
        self._send(tracker, SUMMARY, summary, step)
        self._keep(tracker)

    def _send(self, tracker: Tracker, section: str, record: Mapping[str, Any], step: int) -> None:
        """Sends the numbers of a record, unless the section is as far already, as after an interruption."""
        steps = self._kept["steps"]
        if step > steps.get(section, -1):
            tracker.scalars(numbers(record, section), step)
            steps[section] = step

    def _keep(self, tracker: Tracker) -> None:
        write_json(self._run.path / tracker.name / "tracked.json", self._kept)


def numbers(record: Mapping[str, Any], section: str) -> dict[str, float]:
    """The finite numbers of a record by name, such as policy/success; those of the records in it as well."""
    found: dict[str, float] = {}
    for name, value in record.items():
        if isinstance(value, Mapping):
            found |= numbers(value, f"{section}/{name}")
        elif isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value):
            found[f"{section}/{name}"] = value
    return found
