"""What every result file says about how it came about."""

import os
import platform
import shlex
import subprocess
import sys
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from graphrl_jax.runs import device, versions


def measured_on(benchmark: str) -> dict[str, Any]:
    """Command, commit, hardware, versions and date of a measurement by `benchmarks.<benchmark>`."""
    return {
        "command": shlex.join(["python", "-m", f"benchmarks.{benchmark}", *sys.argv[1:]]),
        "commit": _commit(),
        "device": device(),
        "hardware": {"machine": platform.machine(), "cpu_count": os.cpu_count(), "load": os.getloadavg()[0]},
        "versions": versions(),
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
    }


def _commit() -> str:
    """The commit measured, marked "-dirty" if other files than results have changed since; "unknown" without one."""
    commit = _git("rev-parse", "HEAD")
    changed = _git("status", "--porcelain", "--untracked-files=no", "--", ".", ":(exclude)benchmarks/results")
    return f"{commit}-dirty" if commit and changed else commit or "unknown"


def _git(*arguments: str) -> str:
    """What git answers in this repository; nothing if it cannot."""
    try:
        answer = subprocess.run(
            ["git", *arguments], cwd=Path(__file__).parents[1], capture_output=True, text=True, check=False
        )
    except OSError:
        return ""
    return answer.stdout.strip()
