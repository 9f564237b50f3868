"""Commands in this process, and what they write."""

import contextlib
import io
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from graphrl_jax import cli

TRAIN = ["--task", "carry", "--preset", "smoke"]


def call(main: Callable[[list[str]], None], *arguments: object) -> dict:
    """Runs a command in this process; returns the one JSON line that it prints."""
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        main([str(argument) for argument in arguments])
    (line,) = printed.getvalue().splitlines()
    return json.loads(line)


def rejected(
    capsys: pytest.CaptureFixture[str], arguments: list, main: Callable[[list[str]], None] = cli.train_main
) -> str:
    """The one sentence with which a request is turned down."""
    with pytest.raises(SystemExit) as stop:
        main([str(argument) for argument in arguments])
    assert stop.value.code == 2
    printed = capsys.readouterr()
    assert printed.out == "" and printed.err.startswith("error: ") and printed.err.count("\n") == 1
    return printed.err


def finished_run(folder: Path) -> Path:
    """A smoke run of the example task that was never interrupted; made once per folder."""
    out = folder / "finished"
    if not (out / "summary.json").exists():
        call(cli.train_main, *TRAIN, "--out", out)
    return out


def numbers(run: Path) -> dict:
    """The summary without what depends on the clock or on interruptions."""
    summary = json.loads((run / "summary.json").read_text())
    summary["encoder"].pop("pretrain_s", None)
    timing = ("wall_s", "compile_s", "compilation_cache", "resumed", "train_steps_per_s")
    return {name: value for name, value in summary.items() if name not in timing}


def arrays(path: Path) -> dict[str, np.ndarray]:
    """What an .npz holds."""
    with np.load(path) as file:
        return dict(file)


def contents(folder: Path) -> dict[Path, bytes]:
    """Every file of a folder, byte by byte."""
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
