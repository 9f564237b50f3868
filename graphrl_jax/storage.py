"""Storage: atomic writes, JSON, and pytrees by key path."""

import json
import math
import os
import typing
from collections.abc import Callable, Mapping
from dataclasses import is_dataclass
from pathlib import Path
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from safetensors import SafetensorError
from safetensors.numpy import load_file, save

Kind = TypeVar("Kind")

VERSION = 2
"""Version of the pytree format. Version 1 named leaves by their position."""
_VERSION_ENTRY, _ROOT = "version", "tree"


class StorageError(ValueError):
    """A file cannot be read as requested; the message is one sentence that names the file."""


def write_atomically(path: Path, write: Callable[[Path], None]) -> None:
    """Calls `write` on a temporary file next to `path`, then renames it. Missing folders are created.

    Raises:
      OSError: the file cannot be written; the error names `path`, not the temporary file.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.stem}.{os.getpid()}.tmp{path.suffix}")
    try:
        write(temporary)
        _to_disk(temporary)
        os.replace(temporary, path)
        _to_disk(path.parent)
    except OSError as error:
        if error.filename is not None and Path(error.filename) == temporary:
            error.filename = str(path)
        raise
    finally:
        temporary.unlink(missing_ok=True)


def _to_disk(path: Path) -> None:
    """Waits until a file, or a folder's list of files, would survive a power cut."""
    opened = os.open(path, os.O_RDONLY)
    try:
        os.fsync(opened)
    finally:
        os.close(opened)


def write_arrays(path: Path, arrays: dict[str, Any]) -> None:
    """Writes named arrays as one compressed .npz file at exactly `path`, atomically."""

    def write(temporary: Path) -> None:
        # An open file, not a name: NumPy would append .npz to the name.
        with temporary.open("wb") as file:
            np.savez_compressed(file, **arrays)

    write_atomically(path, write)


def to_json(value: Any, indent: int | None = None) -> str:
    """A value as JSON, which knows no NaN and no infinity: they become null."""
    return json.dumps(_finite(value), indent=indent, allow_nan=False)


def write_json(path: Path, value: Any) -> None:
    """Writes `value` as indented JSON, atomically; see `to_json`."""
    write_atomically(path, lambda temporary: temporary.write_text(to_json(value, indent=2) + "\n"))


def read_json(path: Path) -> Any:
    """Reads a JSON file.

    Raises:
      StorageError: the file is missing or is not JSON.
    """
    try:
        return json.loads(path.read_text())
    except FileNotFoundError:
        raise StorageError(f"{path} is missing: {path.parent} holds no run, or one that has not got that far") from None
    except (OSError, UnicodeDecodeError, json.JSONDecodeError) as error:
        raise StorageError(f"{path} cannot be read as JSON: {error}") from None


def from_plain(kind: type[Kind], values: Any, what: str, prefix: str = "") -> Kind:
    """A dataclass from parsed JSON, nested dataclasses included.

    Args:
      kind: the dataclass; its fields are dataclasses, tuples, literals, or plain values.
      values: its fields by name.
      what: what is read, for messages.
      prefix: place of the dataclass in what is read, such as ppo_config.

    Raises:
      ValueError: a field is missing, unknown or of a wrong type, or the dataclass refuses its value.
    """
    kinds = typing.get_type_hints(kind)
    if not isinstance(values, Mapping):
        raise ValueError(f"{what}: {prefix.rstrip('.')} is {values!r}; allowed: an object of {', '.join(kinds)}")
    for name in sorted(values.keys() ^ kinds.keys()):
        raise ValueError(f"{what}: {prefix}{name} is {'missing' if name in kinds else 'unknown'}")
    made = {}
    for name, value in values.items():
        nested = is_dataclass(kinds[name])
        place = f"{prefix}{name}"
        made[name] = (
            from_plain(kinds[name], value, what, f"{place}.") if nested else _plain(kinds[name], value, what, place)
        )
    return kind(**made)


def _plain(hint: Any, value: Any, what: str, name: str) -> Any:
    """A value from JSON, after a check of its type; a config class checks which values are allowed."""
    if typing.get_origin(hint) is tuple:
        if not isinstance(value, list | tuple):
            raise ValueError(f"{what}: {name} is {value!r}; allowed: a list")
        return tuple(_plain(typing.get_args(hint)[0], one, what, name) for one in value)
    allowed = (str,) if typing.get_origin(hint) is typing.Literal else typing.get_args(hint) or (hint,)
    # JSON does not tell 1 from 1.0.
    if type(value) not in ((*allowed, int) if float in allowed else allowed):
        names = " or ".join(getattr(kind, "__name__", str(kind)) for kind in allowed)
        raise ValueError(f"{what}: {name} is {value!r}; allowed: {names}")
    return value


def save_tree(path: Path, tree: Any) -> None:
    """Saves a pytree as a compressed .npz file: every leaf, typed keys included, under its key path.

    Raises:
      StorageError: a leaf is not finite; nothing is written.
    """
    write_arrays(path, {_VERSION_ENTRY: np.int32(VERSION), **_finite_arrays(path, tree)})


def load_tree(path: Path, like: Any) -> Any:
    """Loads a file written by `save_tree` into the structure of `like` (arrays or shapes).

    Raises:
      StorageError: the file is missing, damaged or of another version, or its leaves differ from those of `like` in
        name, shape or dtype; the message names the leaf.
    """
    return _restored(path, _read_arrays(path), like)


def save_tensors(path: Path, tree: Any) -> None:
    """As `save_tree`, in the safetensors format, which other programs read.

    Raises:
      StorageError: a leaf is not finite; nothing is written.
    """
    content = save(_finite_arrays(path, tree))
    write_atomically(path, lambda temporary: temporary.write_bytes(content))


def load_tensors(path: Path, like: Any) -> Any:
    """Loads a file written by `save_tensors` into the structure of `like` (arrays or shapes).

    Raises:
      StorageError: the file is missing or damaged, or its leaves differ from those of `like`; see `load_tree`.
    """
    try:
        arrays = load_file(path)
    except FileNotFoundError:
        raise StorageError(f"{path} is missing") from None
    except (OSError, SafetensorError) as error:
        raise StorageError(f"{path} is damaged or no safetensors file: {error}") from None
    return _restored(path, arrays, like)


def _finite_arrays(path: Path, tree: Any) -> dict[str, np.ndarray]:
    """All leaves by key path, for a file at `path`.

    Raises:
      StorageError: a leaf is not finite.
    """
    arrays = {_entry(key_path): _to_numpy(leaf) for key_path, leaf in jax.tree_util.tree_leaves_with_path(tree)}
    for name, array in arrays.items():
        if np.issubdtype(array.dtype, np.floating) and not np.isfinite(array).all():
            raise StorageError(f"{path} is not written, because {name} is not finite")
    return arrays


def _restored(path: Path, arrays: Mapping[str, np.ndarray], like: Any) -> Any:
    """The arrays of a file in the structure of `like`; see `load_tree`."""
    leaves, structure = jax.tree_util.tree_flatten_with_path(like)
    wanted = {_entry(key_path): leaf for key_path, leaf in leaves}
    for name in sorted(wanted.keys() - arrays.keys()):
        raise StorageError(f"{path} lacks {name}, which this program needs")
    for name in sorted(arrays.keys() - wanted.keys()):
        raise StorageError(f"{path} holds {name}, which this program does not know")
    return jax.tree.unflatten(structure, [_from_numpy(path, name, arrays[name], leaf) for name, leaf in wanted.items()])


def save_generation(path: Path, tree: Any) -> None:
    """As `save_tree`, and keeps the file that was there before; see `load_generation`.

    Raises:
      StorageError: see `save_tree`.
    """
    newest = path.with_name(f".{path.stem}.newest{path.suffix}")
    save_tree(newest, tree)
    if path.exists():
        os.replace(path, _previous(path))
    os.replace(newest, path)


def has_generation(path: Path) -> bool:
    """Whether `load_generation` finds a file."""
    return path.exists() or _previous(path).exists()


def load_generation(path: Path, like: Any) -> tuple[Any, str | None]:
    """As `load_tree`; if the file is missing or damaged, the one before it.

    Returns:
      The pytree, and one sentence about what was lost, if anything.

    Raises:
      StorageError: see `load_tree`; both files cannot be read.
    """
    try:
        return load_tree(path, like), None
    except StorageError as error:
        if not _previous(path).exists():
            raise
        try:
            return load_tree(_previous(path), like), f"{error}; going on from {_previous(path)}"
        except StorageError:
            raise error from None


def is_key(leaf: Any) -> bool:
    """Whether a leaf holds typed random keys."""
    return jnp.issubdtype(leaf.dtype, jax.dtypes.prng_key)


def _finite(value: Any) -> Any:
    """The same nested lists and dicts with None in place of floats that are not finite."""
    if isinstance(value, dict):
        return {name: _finite(one) for name, one in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(one) for one in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _previous(path: Path) -> Path:
    return path.with_name(f"{path.stem}.previous{path.suffix}")


def _entry(key_path: tuple[Any, ...]) -> str:
    """Name of a leaf in a file, such as tree/params/head/0/weight."""
    return "/".join([_ROOT, *([jax.tree_util.keystr(key_path, simple=True, separator="/")] if key_path else [])])


def _read_arrays(path: Path) -> dict[str, np.ndarray]:
    """All leaves of a file by name, after a check of its version."""
    try:
        # Opened here, because NumPy does not close a file that it cannot read.
        with path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
    except FileNotFoundError:
        raise StorageError(f"{path} is missing") from None
    except Exception as error:  # numpy and zipfile raise half a dozen types for a damaged file
        raise StorageError(f"{path} is damaged or no checkpoint: {error}") from None
    version = arrays.pop(_VERSION_ENTRY, None)
    if version is None or version.shape != () or version != VERSION:
        raise StorageError(f"{path} has format version {version}; this release reads version {VERSION} only")
    return arrays


def _to_numpy(leaf: Any) -> np.ndarray:
    leaf = jnp.asarray(leaf)
    return np.asarray(jax.random.key_data(leaf) if is_key(leaf) else leaf)


def _from_numpy(path: Path, name: str, array: np.ndarray, like: Any) -> jax.Array:
    """One leaf, after a check of its shape and dtype against `like`."""
    key = is_key(like)
    expected = jax.eval_shape(jax.random.key_data, like) if key else like
    if array.shape != expected.shape or array.dtype != expected.dtype:
        raise StorageError(
            f"{path}: {name} is {array.dtype}{list(array.shape)}, but this program needs "
            f"{expected.dtype}{list(expected.shape)}"
        )
    return jax.random.wrap_key_data(jnp.asarray(array)) if key else jnp.asarray(array)
