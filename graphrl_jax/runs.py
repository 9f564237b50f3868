"""The run directory: everything a run made, and all that evaluating, replaying or resuming it needs.

    config.json      what the run was asked for          encoder.npz    the learned reward (graph rewards only)
    metrics.jsonl    one line per logged step            policy.npz     policy and observation statistics
    summary.json     the run's final numbers             train_state.npz  everything PPO's next update depends on
    figures/         pictures                            rollout.mp4    a few episodes

Every file is written to a temporary name and renamed, so an interrupted run leaves whole files only.
"""

import importlib.metadata
import json
import os
import platform
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

VERSION = 1


class RunError(ValueError):
    """A run directory that cannot be used as asked; one sentence that names it."""


def write_atomically(path: Path, write: Callable[[Path], None]) -> None:
    """Lets `write` fill a temporary file beside `path` and renames it. Missing folders are made."""
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.stem}.{os.getpid()}.tmp{path.suffix}")
    try:
        write(temporary)
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def write_json(path: Path, value: Any) -> None:
    """Writes `value` as indented JSON, whole or not at all."""
    write_atomically(path, lambda temporary: temporary.write_text(json.dumps(value, indent=2) + "\n"))


def read_json(path: Path) -> Any:
    """Reads a JSON file.

    Raises:
      RunError: the file is missing or no JSON.
    """
    try:
        return json.loads(path.read_text())
    except FileNotFoundError:
        raise RunError(f"{path} is missing: {path.parent} holds no run, or one that has not got that far") from None
    except (OSError, UnicodeDecodeError, json.JSONDecodeError) as error:
        raise RunError(f"{path} cannot be read as JSON: {error}") from None


def save_tree(path: Path, tree: Any) -> None:
    """Saves every leaf of a pytree, typed keys included, as a compressed .npz."""
    arrays = {f"leaf_{i}": _to_numpy(leaf) for i, leaf in enumerate(jax.tree.leaves(tree))}

    def write(temporary: Path) -> None:
        with temporary.open("wb") as file:
            np.savez_compressed(file, version=np.int32(VERSION), **arrays)

    write_atomically(path, write)


def load_tree(path: Path, like: Any) -> Any:
    """Loads what `save_tree` wrote into the structure of `like` (arrays or shapes).

    Raises:
      RunError: the file is missing, damaged, or its leaves differ from those of `like` in number, shape or dtype.
    """
    leaves, structure = jax.tree.flatten(like)
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = [file[f"leaf_{i}"] for i in range(len(file.files) - 1)]
    except FileNotFoundError:
        raise RunError(f"{path} is missing") from None
    except Exception as error:  # numpy and zipfile raise half a dozen kinds for a damaged file
        raise RunError(f"{path} is damaged or no checkpoint: {error}") from None
    if len(arrays) != len(leaves):
        raise RunError(f"{path} holds {len(arrays)} arrays, but this program needs {len(leaves)}")
    restored = [_from_numpy(path, i, array, leaf) for i, (array, leaf) in enumerate(zip(arrays, leaves, strict=True))]
    return jax.tree.unflatten(structure, restored)


def is_key(leaf: Any) -> bool:
    """Whether a leaf holds typed random keys."""
    return jnp.issubdtype(leaf.dtype, jax.dtypes.prng_key)


def _to_numpy(leaf: Any) -> np.ndarray:
    leaf = jnp.asarray(leaf)
    return np.asarray(jax.random.key_data(leaf) if is_key(leaf) else leaf)


def _from_numpy(path: Path, index: int, array: np.ndarray, like: Any) -> jax.Array:
    if is_key(like):
        return jax.random.wrap_key_data(jnp.asarray(array))
    if array.shape != like.shape or array.dtype != like.dtype:
        raise RunError(
            f"{path}: array {index} is {array.dtype}{list(array.shape)}, but this program needs "
            f"{like.dtype}{list(like.shape)}"
        )
    return jnp.asarray(array)


class Run:
    """A run's folder.

    Args:
      path: the folder.
    """

    def __init__(self, path: str | Path):
        self.path = Path(path)

    @classmethod
    def create(cls, path: str | Path, config: dict[str, Any]) -> "Run":
        """Starts a new run in an empty or missing folder.

        Raises:
          RunError: the folder holds something already; nothing is touched.
        """
        run = cls(path)
        if run.path.exists() and (not run.path.is_dir() or any(run.path.iterdir())):
            raise RunError(f"--out {run.path} is not empty; choose another folder, or continue that run with --resume")
        write_json(run.path / "config.json", config)
        return run

    @property
    def config(self) -> dict[str, Any]:
        """What the run was asked for."""
        return read_json(self.path / "config.json")

    @property
    def figures(self) -> Path:
        """Folder of pictures."""
        return self.path / "figures"

    def log(self, record: dict[str, Any]) -> None:
        """Appends one line to metrics.jsonl."""
        with (self.path / "metrics.jsonl").open("a") as file:
            file.write(json.dumps(record) + "\n")

    def records(self, stage: str) -> list[dict[str, Any]]:
        """All logged lines of a stage; a line cut short by an interruption is left out."""
        path = self.path / "metrics.jsonl"
        records = []
        for line in path.read_text().splitlines() if path.exists() else []:
            try:
                record = json.loads(line)
            except json.JSONDecodeError:
                continue
            if record.get("stage") == stage:
                records.append(record)
        return records

    def forget_after(self, stage: str, key: str, last: float) -> None:
        """Drops the lines of a stage whose `key` exceeds `last`: they lie behind the checkpoint resumed from."""
        path = self.path / "metrics.jsonl"
        if not path.exists():
            return
        kept = []
        for line in path.read_text().splitlines():
            try:
                record = json.loads(line)
            except json.JSONDecodeError:
                continue
            if record.get("stage") != stage or record[key] <= last:
                kept.append(line + "\n")
        write_atomically(path, lambda temporary: temporary.write_text("".join(kept)))


def plain(values: dict[str, Any]) -> dict[str, Any]:
    """Values of a request as JSON knows them: paths become texts."""
    return {name: str(value) if isinstance(value, Path) else value for name, value in values.items()}


def versions() -> dict[str, str]:
    """Versions of Python and of the packages that decide the numbers."""
    packages = ("jax", "jaxlib", "brax", "mujoco", "mujoco-mjx", "numpy", "graphrl_jax")
    found = {"python": platform.python_version()}
    for package in packages:
        try:
            found[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            found[package] = "not installed"
    return found


def device() -> str:
    """The device computed on, and the number of CPU cores."""
    return f"{jax.devices()[0].device_kind} ({jax.default_backend()}), {os.cpu_count()} CPU cores"
