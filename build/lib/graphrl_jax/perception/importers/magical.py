"""Reader of MAGICAL's demonstrations (`.pkl.gz`) that runs no code named by a pickle.

A pickle names the functions that rebuild it. This reader refuses every name outside a short list before it is looked
up, and replaces the names on the list by its own functions. The file builds no numpy object itself, because a forged
dtype alone could point anywhere into memory. Arrays are made from the bytes in the file and hold plain numbers only.
"""

import gzip
import io
import math
import pickle
from collections import OrderedDict, namedtuple
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from graphrl_jax.perception.importers.recording import ImportFailure, Recording, Recordings

VIEW = "allo"
"""The view from above; the robot's view is `ego`."""
MAX_BYTES = 1 << 30
_NUMBERS = ("b1", "u1", "i4", "i8", "f4", "f8")
_Trajectory = namedtuple("_Trajectory", ("acts", "obs", "rews", "infos"))


class _Number:
    """Replacement of a numpy dtype: one of `_NUMBERS`."""

    def __init__(self, code: str, *_: Any):
        if code not in _NUMBERS:
            raise pickle.UnpicklingError(f"it holds numbers of kind {code!r}; allowed: {', '.join(_NUMBERS)}")
        self.dtype = np.dtype(code)

    def build(self, state: Any) -> None:
        """Accepts only the state of plain numbers, in either byte order."""
        if tuple(state)[2:] != (None, None, None, -1, -1, 0) or state[1] not in ("<", "|", ">", "="):
            raise pickle.UnpicklingError("it holds numbers of an unusual kind")
        self.dtype = self.dtype.newbyteorder(state[1]) if state[1] in "<>" else self.dtype


class _Array:
    """Replacement of a numpy array; `value` is set when it is built."""

    value: np.ndarray | None = None

    def build(self, state: Any) -> None:
        """Makes the array from its state: version, shape, dtype, memory order and bytes."""
        _, shape, number, fortran, data = state
        if not isinstance(number, _Number) or not isinstance(data, bytes) or not all(type(n) is int for n in shape):
            raise pickle.UnpicklingError("it holds an array of other things than numbers")
        if min(shape, default=0) < 0 or math.prod(shape) * number.dtype.itemsize != len(data):
            raise pickle.UnpicklingError(f"it holds an array of shape {shape} in {len(data)} bytes")
        self.value = np.frombuffer(data, number.dtype).reshape(shape, order="F" if fortran else "C")


def _scalar(number: Any, data: bytes) -> float | int:
    """Replacement of numpy's function for a scalar."""
    return np.frombuffer(data, number.dtype, count=1)[0].item()


_NUMPY: dict[str, Callable[..., Any]] = {"_reconstruct": lambda *_: _Array(), "scalar": _scalar}
_ALLOWED: dict[tuple[str, str], Any] = {
    ("milbench.baselines.saved_trajectories", "MILBenchTrajectory"): _Trajectory,
    ("magical.saved_trajectories", "MAGICALTrajectory"): _Trajectory,
    ("collections", "OrderedDict"): OrderedDict,
    ("numpy", "ndarray"): None,  # used as an argument only
    ("numpy", "dtype"): _Number,
    **{(f"numpy.{core}.multiarray", name): made for core in ("core", "_core") for name, made in _NUMPY.items()},
}
# Opcodes that fill the memory, refer to objects outside the file, or build objects that are not allowed above.
_REFUSED = (
    pickle.BYTEARRAY8, pickle.NEXT_BUFFER, pickle.READONLY_BUFFER, pickle.PERSID, pickle.BINPERSID, pickle.EXT1,
    pickle.EXT2, pickle.EXT4, pickle.INST, pickle.OBJ, pickle.NEWOBJ_EX,
)  # fmt: skip


class _Unpickler(pickle._Unpickler):  # the version in C allocates a table as long as the file says
    """Unpickler that rebuilds only the objects of MAGICAL's files."""

    def find_class(self, module_name: str, global_name: str) -> Any:
        if (module_name, global_name) not in _ALLOWED:
            raise pickle.UnpicklingError(f"it asks for {module_name}.{global_name}, which is not allowed")
        return _ALLOWED[module_name, global_name]

    def load_build(self) -> None:
        state = self.stack.pop()
        built = self.stack[-1]
        if type(built) not in (_Number, _Array):
            raise pickle.UnpicklingError(f"it changes a {type(built).__name__}, which is not allowed")
        built.build(state)

    def refuse(self) -> None:
        raise pickle.UnpicklingError("it is written in a way that MAGICAL's files are not")

    dispatch = {
        **pickle._Unpickler.dispatch,
        pickle.BUILD[0]: load_build,
        **dict.fromkeys([opcode[0] for opcode in _REFUSED], refuse),
    }


def load_trajectory(path: Path) -> dict[str, Any]:
    """The dict in a file: `trajectory` with `acts`, `obs`, `rews`, `infos`; `score`; `env_name`.

    Raises:
      ImportFailure: the file is damaged, is too large, asks for a name that is not allowed, or has no trajectory.
    """
    try:
        with gzip.open(path) as file:
            raw = file.read(MAX_BYTES + 1)
        if len(raw) > MAX_BYTES:
            raise pickle.UnpicklingError(f"more than {MAX_BYTES >> 20} MB unpacked")
        content = _Unpickler(io.BytesIO(raw)).load()
    except Exception as error:  # a damaged stream makes the unpickler raise almost any exception
        raise ImportFailure(f"{path}: no trajectory of MAGICAL's: {error or type(error).__name__}") from None
    if not isinstance(content, dict) or not isinstance(content.get("trajectory"), _Trajectory):
        raise ImportFailure(f"{path}: holds no field 'trajectory' as MAGICAL's files do")
    return content


def frames_of(content: dict[str, Any], path: Path) -> np.ndarray:
    """Frames (T, H, W, 3) uint8 of the view from above.

    Raises:
      ImportFailure: there are no frames, they are not images of one size, or they are larger than `MAX_BYTES`.
    """
    observations = content["trajectory"].obs
    if not isinstance(observations, list) or not observations:
        raise ImportFailure(f"{path}: obs is empty; allowed: one frame or more")
    frames: list[np.ndarray] = []
    for number, observation in enumerate(observations):
        frame = observation.get(VIEW) if isinstance(observation, dict) else None
        frame = frame.value if isinstance(frame, _Array) else None
        good = frame is not None and frame.dtype == np.uint8 and frame.ndim == 3 and frame.shape[2] == 3
        if frame is None or not good or (frames and frame.shape != frames[0].shape):
            raise ImportFailure(f"{path}: obs[{number}][{VIEW!r}] is no (H, W, 3) uint8 image of the first one's size")
        if len(observations) * frame.nbytes > MAX_BYTES:
            raise ImportFailure(f"{path}: {len(observations)} frames are more than {MAX_BYTES >> 20} MB")
        frames.append(frame)
    return np.stack(frames)


def read_trajectories(files: list[Path]) -> Recordings:
    """Yields a recording per `.pkl.gz` file."""
    for path in files:
        content = load_trajectory(path)
        score = content.get("score")
        if not isinstance(score, float | int) or not math.isfinite(score):
            raise ImportFailure(f"{path}: score is of type {type(score).__name__}; allowed: a finite number")
        yield Recording(path, frames_of(content, path), success=score >= 1.0)
