"""The command line: `graphrl COMMAND`, `python -m graphrl_jax COMMAND`, and `train.py` for `graphrl train`.

This file and `requests.py` import neither JAX nor a command, so that help is fast. A request that cannot be carried out
(bad file, unknown name, a folder that holds another run) prints one sentence on standard error, exits with code 2 and
writes nothing. A command that succeeds prints one JSON line on standard output.
"""

import contextlib
import importlib
import io
import os
import sys
from collections.abc import Iterator
from typing import Any, TextIO

import tyro

from graphrl_jax.cli import requests
from graphrl_jax.cli.options import refuse_seeds

COMMANDS: dict[str, tuple[type, str]] = {
    "train": (requests.Train, "train"),
    "demos": (requests.Demos, "demos"),
    "objects": (requests.Objects, "objects"),
    "import": (requests.Import, "import_recordings"),
    "pretrain": (requests.Pretrain, "pretrain"),
    "evaluate": (requests.Evaluate, "evaluate"),
    "stages": (requests.Stages, "stages"),
    "score": (requests.Score, "score"),
    "report": (requests.Report, "report"),
    "sweep": (requests.Sweep, "sweep"),
}
"""By name: the request class, and the module in this package with the `run` function of the command."""


def main(args: list[str] | None = None) -> None:
    """Entry point of `graphrl` and `python -m graphrl_jax`."""
    kinds = {name: request for name, (request, _) in COMMANDS.items()}
    _carry_out(tyro.extras.subcommand_cli_from_dict(kinds, args=args, prog="graphrl"))


def train_main(args: list[str] | None = None) -> None:
    """Entry point of `train.py`."""
    _carry_out(tyro.cli(requests.Train, args=args))


def _carry_out(request: Any) -> None:
    name = dict(COMMANDS.values())[type(request)]
    # MJX announces on import that Warp, an optional backend, is missing.
    with contextlib.redirect_stdout(io.StringIO()):
        command, storage = map(importlib.import_module, (f"{__name__}.{name}", "graphrl_jax.storage"))
    with _output_of_libraries_aside() as stdout:
        try:
            refuse_seeds(request)
            answer = command.run(request)
        except (ValueError, OSError) as error:
            print(f"error: {error}", file=sys.stderr)
            raise SystemExit(2) from None
        print(storage.to_json(answer), file=stdout, flush=True)


@contextlib.contextmanager
def _output_of_libraries_aside() -> Iterator[TextIO]:
    """Sends everything that is printed to standard error, and yields the standard output for the answer.

    Compiled libraries print as well, some of them when the process ends. Their way to standard output is therefore
    closed for good, unless somebody has replaced `sys.stdout`, as tests do.
    """
    stdout = sys.stdout
    if stdout is sys.__stdout__:
        stdout = os.fdopen(os.dup(stdout.fileno()), "w")
        os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    with contextlib.redirect_stdout(sys.stderr):
        yield stdout
