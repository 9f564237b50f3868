"""MAGICAL's demonstrations, `.pkl.gz`, read without running what a pickle could tell Python to run.

A pickle names the functions that rebuild it. Those of MAGICAL need a few of numpy's, and one class of a package that
nobody needs to have installed; every other name is refused before it is looked up. A limit keeps a small file from
filling the memory.
"""

import gzip
import io
import pickle
from collections import OrderedDict, namedtuple
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy._core.multiarray import _reconstruct, scalar

from graphrl_jax.importers.recording import ImportFailure, Recording, Recordings

VIEW = "allo"
"""The view from above; the robot's own is `ego`."""
MAX_BYTES = 1 << 30
_Trajectory = namedtuple("_Trajectory", ("acts", "obs", "rews", "infos"))
_TRAJECTORY = ("milbench.baselines.saved_trajectories", "MILBenchTrajectory")
_ALLOWED: dict[tuple[str, str], Any] = {
    _TRAJECTORY: _Trajectory,
    ("magical.saved_trajectories", "MAGICALTrajectory"): _Trajectory,
    ("collections", "OrderedDict"): OrderedDict,
    ("numpy", "ndarray"): np.ndarray,
    ("numpy", "dtype"): np.dtype,
    **{(f"numpy.{core}.multiarray", "_reconstruct"): _reconstruct for core in ("core", "_core")},
    **{(f"numpy.{core}.multiarray", "scalar"): scalar for core in ("core", "_core")},
}


class _Unpickler(pickle.Unpickler):
    """Rebuilds nothing but what MAGICAL's files are made of."""

    def find_class(self, module_name: str, global_name: str) -> Any:
        if (module_name, global_name) not in _ALLOWED:
            raise pickle.UnpicklingError(f"it asks for {module_name}.{global_name}, which is not allowed")
        return _ALLOWED[module_name, global_name]

    def persistent_load(self, pid: Any) -> Any:
        raise pickle.UnpicklingError("it refers to objects outside itself, which is not allowed")


def load_trajectory(path: Path) -> dict[str, Any]:
    """The dict in a file: `trajectory` with `acts`, `obs`, `rews`, `infos`; `score`; `env_name`.

    Raises:
      ImportFailure: the file is damaged, too large, asks for anything foreign, or holds something else.
    """
    try:
        with gzip.open(path) as file:
            raw = file.read(MAX_BYTES + 1)
        if len(raw) > MAX_BYTES:
            raise ImportFailure(f"{path}: more than {MAX_BYTES >> 20} MB unpacked; no demonstration is that large")
        content = _Unpickler(io.BytesIO(raw)).load()
    except ImportFailure:
        raise
    except (
        Exception
    ) as error:  # a broken stream makes the unpickler raise almost anything, and all of it means the same
        raise ImportFailure(f"{path}: no trajectory of MAGICAL's: {error or type(error).__name__}") from None
    if not isinstance(content, dict) or not isinstance(content.get("trajectory"), _Trajectory):
        raise ImportFailure(f"{path}: holds no field 'trajectory' as MAGICAL's files do")
    return content


def frames_of(content: dict[str, Any], path: Path) -> np.ndarray:
    """Frames (T, H, W, 3) uint8 of the view from above.

    Raises:
      ImportFailure: there are none, or they are no pictures of one size.
    """
    observations = content["trajectory"].obs
    if not isinstance(observations, Sequence) or not observations:
        raise ImportFailure(f"{path}: obs is empty; allowed: one frame or more")
    frames = []
    for number, observation in enumerate(observations):
        frame = observation.get(VIEW) if isinstance(observation, dict) else None
        good = isinstance(frame, np.ndarray) and frame.dtype == np.uint8 and frame.ndim == 3 and frame.shape[2] == 3
        if not good or (frames and frame.shape != frames[0].shape):
            raise ImportFailure(
                f"{path}: obs[{number}][{VIEW!r}] is no (H, W, 3) uint8 picture of the first one's size"
            )
        frames.append(frame)
    return np.stack(frames)


def read_trajectories(source: Path) -> Recordings:
    """Recordings of a `.pkl.gz` file or of all in a folder, in order of their names."""
    for path in [source] if source.is_file() else sorted(source.glob("*.pkl.gz")):
        content = load_trajectory(path)
        score = content.get("score")
        if not isinstance(score, float | int | np.floating):
            raise ImportFailure(f"{path}: score is {score!r}; allowed: a number")
        yield Recording(path, frames_of(content, path), success=bool(score >= 1.0))
