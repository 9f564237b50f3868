"""Reader of robomimic's HDF5 files."""

import re
from pathlib import Path, PurePath
from typing import Any

import numpy as np

from graphrl_jax.perception.importers.datasets import chosen_camera, json_object, rate, whole
from graphrl_jax.perception.importers.recording import ImportFailure, Recording, Recordings, natural_key
from graphrl_jax.runtime import optional_package

_DEMONSTRATION = re.compile("demo_(0|[1-9][0-9]*)")
_CAMERA = re.compile("(.+)_image")


def read_robomimic(files: list[Path], camera: str | None) -> Recordings:
    """Yields a recording per demonstration `data/demo_<number>` of each file, in order of the numbers.

    Pictures are `obs/<camera>_image`. The frame rate is the control frequency in `env_args`, if it is there. All count
    as successes: what `dones` and `rewards` mean depends on how the file was made.

    Args:
      files: the files.
      camera: name of a camera; None takes the only one.

    Raises:
      ImportFailure: h5py is not installed, a file is damaged, or a field is missing or wrong.
    """
    h5py = optional_package("h5py", "robomimic", "files of robomimic need", ImportFailure)
    for path in files:
        try:
            with h5py.File(path, "r") as file:
                yield from _recordings(file, path, camera)
        except ImportFailure:
            raise
        except (OSError, RuntimeError, LookupError, TypeError, ValueError) as error:
            raise ImportFailure(f"{path}: no HDF5 that can be read: {' '.join(str(error).split())}") from None


def _recordings(file: Any, path: Path, asked: str | None) -> Recordings:
    """The recordings of an open file."""
    data = _group(file, "data", str(path))
    names = _names(data, path)
    lengths = [_whole(data[name].attrs.get("num_samples"), f"{path}: data/{name}: num_samples", 1) for name in names]
    total = data.attrs.get("total")
    if total is not None and _whole(total, f"{path}: total") != sum(lengths):
        raise ImportFailure(f"{path}: total is {total}; its demonstrations have {sum(lengths)} samples")
    cameras = [_cameras(_group(data[name], "obs", f"{path}: data/{name}")) for name in names]
    camera = chosen_camera(path, cameras[0], asked) if names else ""
    frame_rate = _frame_rate(data.attrs.get("env_args"), f"{path}: env_args")
    for name, length, known in zip(names, lengths, cameras, strict=True):
        chosen_camera(path / name, known, camera)
        images = data[name]["obs"][f"{camera}_image"]
        _check_images(images, length, f"{path}: data/{name}/obs/{camera}_image")
        yield Recording(path / name, images[()], frame_rate=frame_rate)


def _group(parent: Any, name: str, where: str) -> Any:
    group = parent.get(name)
    if not hasattr(group, "keys"):
        raise ImportFailure(f"{where}: group {name} is missing; allowed: a file of robomimic's")
    return group


def _names(data: Any, path: Path) -> list[str]:
    """The demonstrations, sorted by their numbers: 2 before 10."""
    for name in data:
        if not _DEMONSTRATION.fullmatch(name) or not hasattr(data[name], "keys"):
            raise ImportFailure(f"{path}: data/{name} is no demonstration; allowed: groups demo_0, demo_1 and so on")
    return sorted(data, key=lambda name: natural_key(PurePath(name)))


def _cameras(observations: Any) -> list[str]:
    return [match[1] for name in observations if (match := _CAMERA.fullmatch(name))]


def _check_images(images: Any, length: int, where: str) -> None:
    """Refuses what is not `length` pictures of 8 bits."""
    shape, dtype = getattr(images, "shape", ()), getattr(images, "dtype", None)
    if dtype != np.uint8 or len(shape) != 4 or shape[3] != 3 or min(shape) < 1:
        raise ImportFailure(f"{where} is of shape {shape} and type {dtype}; allowed: (N, H, W, 3) of uint8")
    if shape[0] != length:
        raise ImportFailure(f"{where} has {shape[0]} pictures; allowed: {length}, as num_samples says")


def _frame_rate(env_args: Any, where: str) -> float | None:
    """The control frequency among the arguments of the environment; None if they do not say it."""
    if env_args is None:
        return None
    text = env_args.decode(errors="replace") if isinstance(env_args, bytes) else str(env_args)
    arguments = json_object(text, where).get("env_kwargs")
    frequency = arguments.get("control_freq") if isinstance(arguments, dict) else None
    return None if frequency is None else rate(frequency, f"{where}: control_freq")


def _whole(value: Any, what: str, least: int = 0) -> int:
    """A whole number, which attributes hold as numpy's."""
    return whole(value.item() if isinstance(value, np.generic) else value, what, least)
