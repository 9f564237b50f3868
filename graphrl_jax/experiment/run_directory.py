"""The run directory: all results of a run, sufficient to evaluate, replay or resume it.

config.json      its settings and commit             model.safetensors, README.md   the reward model and its card
metrics.jsonl    one line per logged step            encoder.json     metrics of the encoder and its audit
summary.json     the run's final metrics             policy.npz       policy and observation statistics
figures/         plots                               train_state.npz  everything PPO's next update depends on
rollout.mp4      a few episodes                      subtasks.json    subtasks found in held-out demonstrations

A tracker has a folder of its name.
"""

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

from graphrl_jax.experiment.settings import Settings, as_json, from_json
from graphrl_jax.reward.card import without_card
from graphrl_jax.runtime import commit
from graphrl_jax.storage import read_json, to_json, write_atomically, write_json

VERSION = 2
"""Version of config.json. Version 1 did not contain the preset's settings."""
RESUMABLE = ("train", "sweep")
"""Commands that continue a run."""


class RunError(ValueError):
    """A run directory cannot be used as requested; the message is one sentence that names it."""


class Run:
    """A run's folder.

    Args:
      path: the folder.

    Attributes:
      on_log: also gets every record that is logged; None for nobody.
    """

    def __init__(self, path: str | Path):
        self.path = Path(path)
        self.on_log: Callable[[dict[str, Any]], None] | None = None

    @classmethod
    def create(cls, path: str | Path, command: str, config: dict[str, Any]) -> "Run":
        """Creates a new run in an empty or missing folder; config.json also holds the command, version and commit.

        Raises:
          RunError: the folder is not empty; it is not changed.
        """
        run = cls(path)
        if run.path.exists() and (not run.path.is_dir() or any(run.path.iterdir())):
            resumable = ", or continue that run with --resume" if command in RESUMABLE else ""
            raise RunError(f"--out {run.path} is not empty; choose another folder{resumable}")
        run.write_config(command, config)
        return run

    @classmethod
    def start(cls, path: str | Path, settings: Settings) -> "Run":
        """Creates a new run of `train` with these settings; see `create`."""
        return cls.create(path, "train", as_json(settings))

    def write_config(self, command: str, config: dict[str, Any]) -> None:
        """Writes config.json, with the command, version and commit."""
        about = {"command": command, "version": VERSION, "commit": commit()}
        write_json(self.path / "config.json", {**about, **config})

    def config(self, *commands: str) -> dict[str, Any]:
        """The run's configuration: config.json without command, version and commit.

        Args:
          commands: commands that may have created the run; default: any.

        Raises:
          RunError: the run is of another command or version.
          StorageError: there is no config.json.
        """
        config = read_json(self.path / "config.json")
        if not isinstance(config, dict):
            raise RunError(f"{self.path}/config.json holds {type(config).__name__}; allowed: an object")
        command, version = config.pop("command", None), config.pop("version", None)
        if version != VERSION or (commands and command not in commands):
            raise RunError(
                f"{self.path}/config.json is of command {command!r}, version {version!r}; allowed: "
                f"{' or '.join(map(repr, commands)) or 'any command'}, version {VERSION}"
            )
        config.pop("commit", None)
        return without_card(config)

    def settings(self, *commands: str) -> Settings:
        """Settings of a run of `train`, or of a member of a sweep.

        Args:
          commands: commands that may have created the run; default: `train`.

        Raises:
          RunError: the run is of another command or version, or its settings are damaged.
          StorageError: there is no config.json.
        """
        config = self.config(*(commands or ("train",)))
        try:
            return from_json(config)
        except ValueError as error:
            raise RunError(f"{self.path}/config.json: {error}") from error

    @property
    def figures(self) -> Path:
        """Folder of plots."""
        return self.path / "figures"

    @property
    def video(self) -> Path:
        """Video of a few episodes."""
        return self.path / "rollout.mp4"

    def log(self, record: dict[str, Any]) -> None:
        """Appends one line to metrics.jsonl; values that are not finite become null."""
        with (self.path / "metrics.jsonl").open("a") as file:
            file.write(to_json(record) + "\n")
        if self.on_log is not None:
            self.on_log(record)

    def records(self, stage: str) -> list[dict[str, Any]]:
        """All logged records of a run stage, `pretrain` or `ppo`, with NaN for null.

        A line cut short by an interruption is left out.
        """
        records = [record for _, record in self._lines() if record.get("stage") == stage]
        return [{name: math.nan if value is None else value for name, value in one.items()} for one in records]

    def forget_after(self, stage: str, key: str, last: float) -> None:
        """Drops the lines of a run stage with `key` above `last`: they are later than the checkpoint to resume from."""
        path = self.path / "metrics.jsonl"
        if path.exists():
            kept = [line for line, record in self._lines() if record.get("stage") != stage or record[key] <= last]
            write_atomically(path, lambda temporary: temporary.write_text("".join(f"{line}\n" for line in kept)))

    def _lines(self) -> list[tuple[str, dict[str, Any]]]:
        """Whole lines of metrics.jsonl, as text and as parsed records."""
        path = self.path / "metrics.jsonl"
        lines = []
        for line in path.read_text().splitlines() if path.exists() else []:
            try:
                lines.append((line, json.loads(line)))
            except json.JSONDecodeError:
                continue
        return lines
