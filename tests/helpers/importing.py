"""Recordings to import, and `graphrl import` in this process."""

import gzip
import pickle
import sys
from collections import OrderedDict, namedtuple
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from graphrl_jax import cli
from tests.helpers.drawings import draw

FRAMES = np.stack([draw(moved={"star": (0.8 - 0.1 * t, -0.7)}) for t in range(4)])
"""A star that moves west, drawn as MAGICAL does."""
SQUARE_BOX = [0.167, 0.147, 0.13, 0.13]


def run(*arguments: object) -> None:
    """Runs `graphrl import`."""
    cli.main(["import", *[str(argument) for argument in arguments]])


def refused(capsys: pytest.CaptureFixture[str], *arguments: Any) -> str:
    """The one sentence that an import ends with; nothing may have been written."""
    out = Path(arguments[0]).parent / "refused.npz"
    with pytest.raises(SystemExit) as stop:
        run(*arguments, "--out", out)
    assert stop.value.code == 2 and not out.exists()
    printed = capsys.readouterr().err
    assert printed.count("error: ") == 1 and "Traceback" not in printed
    return printed.partition("error: ")[2]


def save_trajectory(path: Path, frames: np.ndarray | list, score: object = 1.0, **more: object) -> None:
    """A file as MAGICAL writes it, its class in a module that is gone when the file is read."""
    module = ModuleType("milbench.baselines.saved_trajectories")
    module.MILBenchTrajectory = namedtuple("MILBenchTrajectory", ("acts", "obs", "rews", "infos"))
    module.MILBenchTrajectory.__module__ = module.__name__
    names = ("milbench", "milbench.baselines", module.__name__)
    with pytest.MonkeyPatch.context() as patch:
        for name in names:
            patch.setitem(sys.modules, name, module if name == names[-1] else ModuleType(name))
        observations = [OrderedDict(allo=frame, ego=frame[:8, :8]) for frame in frames]
        trajectory = module.MILBenchTrajectory(
            np.zeros(len(frames), np.int64), observations, [0.0], [{"eval_score": 0}]
        )
        content = {"trajectory": trajectory, "score": score, "env_name": "MatchRegions-Demo-v0", **more}
        path.write_bytes(gzip.compress(pickle.dumps(content)))
