"""Experiment trackers by name. Plain Python, so that help is fast; a tracker's package is imported when a run starts.

A new tracker is a class with the methods of `Tracker`, in `TRACKERS`.
"""

import importlib
import importlib.util
import io
import json
import os
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Protocol

import PIL.Image

from graphrl_jax.viz.gif import as_gif

PROJECT = "graphrl"
"""Project that runs belong to, in trackers that have projects."""
_RGB = 3


class Tracker(Protocol):
    """What a tracker does with one run. Every method may raise any exception.

    Attributes:
      name: its name; also that of the extra which installs its package.
      package: the package that it needs.
    """

    name: str
    package: str

    def start(self, folder: Path, run_id: str, config: Mapping[str, Any]) -> None:
        """Starts a run, or goes on with the one that has this id; `folder` is the run's folder and gives its name."""
        ...

    def scalars(self, values: Mapping[str, float], step: int) -> None:
        """Logs finite numbers by name; what precedes the first slash of a name is its section."""
        ...

    def image(self, name: str, path: Path, step: int) -> None:
        """Logs a PNG file."""
        ...

    def video(self, name: str, path: Path, step: int) -> None:
        """Logs an mp4 file."""
        ...

    def finish(self, complete: bool) -> None:
        """Ends the run; `complete` is False if the training was stopped by an error."""
        ...


class TensorBoard:
    """Event files in `tensorboard/` of the run's folder. A resumed run adds a file, which TensorBoard joins."""

    name, package = "tensorboard", "tensorboardX"

    def start(self, folder: Path, run_id: str, config: Mapping[str, Any]) -> None:
        self._summary, self._event = (self._part(f"proto.{one}_pb2") for one in ("summary", "event"))
        (folder / self.name).mkdir(exist_ok=True)
        # `SummaryWriter` writes later, from a thread, and what a killed run has logged last would be lost. Files are
        # named by the second, and one of the same name would be overwritten.
        writer = self._part("event_file_writer").EventsWriter
        self._file = writer(str(folder / self.name / "events"), f".{time.time_ns()}")
        text = self._part("summary").text("config", f"```json\n{json.dumps(config, indent=2)}\n```")
        self._write(text, 0)

    def scalars(self, values: Mapping[str, float], step: int) -> None:
        self._values([{"tag": name, "simple_value": value} for name, value in values.items()], step)

    def image(self, name: str, path: Path, step: int) -> None:
        self._encoded(name, path.read_bytes(), step)

    def video(self, name: str, path: Path, step: int) -> None:
        # TensorBoard plays GIFs and no mp4. For them, tensorboardX would need the package moviepy.
        self._encoded(name, as_gif(path), step)

    def finish(self, complete: bool) -> None:
        self._file.close()

    def _part(self, module: str) -> Any:
        return importlib.import_module(f"{self.package}.{module}")

    def _encoded(self, name: str, content: bytes, step: int) -> None:
        """Logs an image file as it is."""
        width, height = PIL.Image.open(io.BytesIO(content)).size
        image = {"width": width, "height": height, "colorspace": _RGB, "encoded_image_string": content}
        self._values([{"tag": name, "image": image}], step)

    def _values(self, values: list[dict[str, Any]], step: int) -> None:
        self._write(self._summary.Summary(value=values), step)

    def _write(self, summary: Any, step: int) -> None:
        self._file.write_event(self._event.Event(wall_time=time.time(), step=step, summary=summary))
        self._file.flush()


class WeightsAndBiases:
    """Weights & Biases, which the variables `WANDB_...` of the environment configure."""

    name = package = "wandb"

    def start(self, folder: Path, run_id: str, config: Mapping[str, Any]) -> None:
        self._wandb = importlib.import_module(self.package)
        project = os.environ.get("WANDB_PROJECT", PROJECT)
        self._run = self._wandb.init(
            project=project, id=run_id, name=folder.name, dir=str(folder), config=dict(config), resume="allow"
        )
        # Its own step must never fall, and pretraining and PPO count different steps. So `step` is a metric.
        self._run.define_metric("*", step_metric="step")

    def scalars(self, values: Mapping[str, float], step: int) -> None:
        self._run.log({**values, "step": step})

    def image(self, name: str, path: Path, step: int) -> None:
        self._run.log({name: self._wandb.Image(str(path)), "step": step})

    def video(self, name: str, path: Path, step: int) -> None:
        self._run.log({name: self._wandb.Video(str(path)), "step": step})

    def finish(self, complete: bool) -> None:
        self._run.finish(exit_code=0 if complete else 1)


class Trackio:
    """Trackio, which the variables `TRACKIO_...` of the environment configure. Without them, nothing is uploaded."""

    name = package = "trackio"

    def start(self, folder: Path, run_id: str, config: Mapping[str, Any]) -> None:
        self._trackio = importlib.import_module(self.package)
        # It resumes by name, so names differ between folders of the same name.
        name = f"{folder.name}-{run_id}"
        self._trackio.init(project=PROJECT, name=name, config=dict(config), resume="allow")

    def scalars(self, values: Mapping[str, float], step: int) -> None:
        self._trackio.log(dict(values), step=step)

    def image(self, name: str, path: Path, step: int) -> None:
        self._trackio.log({name: self._trackio.Image(str(path))}, step=step)

    def video(self, name: str, path: Path, step: int) -> None:
        self._trackio.log({name: self._trackio.Video(str(path))}, step=step)

    def finish(self, complete: bool) -> None:
        self._trackio.finish()


TRACKERS: dict[str, type[Tracker]] = {kind.name: kind for kind in (TensorBoard, WeightsAndBiases, Trackio)}


def tracker_named(name: str) -> Tracker:
    """The tracker of a name, not started yet.

    Raises:
      ValueError: there is no such tracker, or its package is not installed.
    """
    if name not in TRACKERS:
        raise ValueError(f"unknown tracker {name!r}; allowed: {', '.join(TRACKERS)}")
    tracker = TRACKERS[name]()
    found = importlib.util.find_spec(tracker.package)
    # Trackers write to folders of their own name, and such a folder in the working directory counts as a package.
    if found is None or found.origin is None:
        raise ValueError(f'--track {name} needs the package {tracker.package}: pip install "graphrl_jax[{name}]"')
    return tracker
