"""What every result file says about how it came about, and where it goes."""

import os
import platform
import shlex
import sys
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from graphrl_jax.runtime import commit, device, versions

RESULTS = Path("benchmarks/results")
"""Seen from the repository's root, where benchmarks are run."""


def measured_on(benchmark: str) -> dict[str, Any]:
    """Command, commit, hardware, versions and date of a measurement by `benchmarks.<benchmark>`."""
    return {
        "command": shlex.join(["python", "-m", f"benchmarks.{benchmark}", *map(portable, sys.argv[1:])]),
        "commit": commit() or "unknown",
        "device": device(),
        "hardware": {"machine": platform.machine(), "cpu_count": os.cpu_count(), "load": os.getloadavg()[0]},
        "versions": versions(),
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
    }


def portable(argument: str) -> str:
    """An argument without folders of this machine: an absolute path relative to the working directory, else its name.

    Args:
      argument: of a command line; a path may follow an option's equals sign.
    """
    option, equals, value = argument.rpartition("=")
    path = Path(value)
    if not path.is_absolute():
        return argument
    here = Path.cwd()
    return f"{option}{equals}{path.relative_to(here) if path.is_relative_to(here) else path.name}"
