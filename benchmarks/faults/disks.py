"""Runs on a file system that gets full, or read-only, while they go on; with room again, they are resumed.

The file systems are small and in memory, which takes the rights of root to mount.
"""

import shutil
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.faults.runs import Ended, begin, difference, end, results

_PLENTY = "64m"


@contextmanager
def small_disk(folder: Path, size: str) -> Iterator[Path]:
    """A file system in memory of a size as `mount` takes it, such as 300k."""
    folder.mkdir(parents=True)
    _mount("-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(folder))
    try:
        yield folder
    finally:
        subprocess.run(["umount", "-l", str(folder)], check=True)


def _mount(*arguments: str) -> None:
    subprocess.run(["mount", *arguments], check=True, capture_output=True)


def can_mount(scratch: Path) -> bool:
    """Whether this process may mount file systems."""
    if shutil.which("mount") is None:
        return False
    try:
        with small_disk(scratch / "probe", "64k"):
            return True
    except subprocess.CalledProcessError:
        return False


def fill(kind: str, undisturbed: Path, scratch: Path, shares: tuple[float, ...]) -> list[dict[str, Any]]:
    """Runs on disks that hold only a share of what the finished run takes."""
    whole = sum(path.stat().st_size for path in undisturbed.rglob("*") if path.is_file())
    rows = []
    for number, share in enumerate(shares):
        with small_disk(scratch / f"full_{number}", f"{max(4, int(share * whole / 1024))}k") as disk:
            ended = end(begin(kind, disk / "run"))
            _mount("-o", f"remount,size={_PLENTY}", str(disk))
            rows.append({"share": share, **_resumed(kind, disk / "run", undisturbed, ended)})
    return rows


def lock(kind: str, undisturbed: Path, scratch: Path, seconds: float, draw: np.random.Generator) -> dict[str, Any]:
    """A run whose disk becomes read-only at a random moment.

    Args:
      kind: of the run.
      undisturbed: folder of one that nothing happened to.
      scratch: folder for the disk.
      seconds: that the undisturbed run took.
      draw: randomness.
    """
    moment = float(draw.uniform(0.2, 0.8) * seconds)
    with small_disk(scratch / f"locked_{moment:.1f}", _PLENTY) as disk:
        process = begin(kind, disk / "run")
        time.sleep(moment)
        while process.poll() is None:
            try:
                _mount("-o", "remount,ro", str(disk))
                break
            except subprocess.CalledProcessError:  # a file is being written
                time.sleep(0.01)
        ended = end(process)
        _mount("-o", "remount,rw", str(disk))
        return {"moment_s": round(moment, 1), **_resumed(kind, disk / "run", undisturbed, ended)}


def _resumed(kind: str, out: Path, undisturbed: Path, ended: Ended) -> dict[str, Any]:
    """How an interrupted run ended, and how it went on."""
    last = end(begin(kind, out))
    return {
        "ended": "finished" if ended.code == 0 else "refused" if ended.in_one_sentence else ended.error[-500:],
        "resumed": "finished" if last.code == 0 else last.error[-500:],
        "difference": difference(results(out), results(undisturbed)) if last.code == 0 else None,
    }
