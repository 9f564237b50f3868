"""Mutations of valid sources: bytes, numbers, structure, names, and files that are missing or there twice."""

import gzip
import json
import re
import shutil
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

Draw = np.random.Generator
_NUMBER = re.compile(rb"-?\d+\.?\d*")
_NUMBERS = (
    b"-1",
    b"0",
    b"nan",
    b"inf",
    b"1e308",
    b"1e-320",
    b"99999999999999999999",
    b"0.5",
    b"1_0",
    b"",
    b"\xff",
    b"2",
)
_VALUES = (None, -1, 0, 1e300, 2**70, "", "0", "..", True, [], {}, [[]], [1], {"id": 1}, "\u0000", float("nan"))
_NAMES = ("9", "frame_", "frame_1", "frame_01", "frame_1e9", "frame_-1", ".hidden", "frame_001 (1)", "a b", "\u00e9",
          "frame_000000000000000000000001", "x" * 200)  # fmt: skip


def mutate(folder: Path, draw: Draw) -> str:
    """Changes a source in place, one to three times; returns what was done."""
    done = []
    for _ in range(int(draw.integers(1, 4))):
        files = sorted(path for path in folder.rglob("*") if path.is_file())
        if files:
            how = _MUTATIONS[int(draw.integers(len(_MUTATIONS)))]
            path = files[int(draw.integers(len(files)))]
            how(path, draw)
            done.append(f"{how.__name__.strip('_')} {path.name}")
    return ", ".join(done)


def _bytes(path: Path, draw: Draw) -> None:
    """Flips, cuts, repeats, removes or inserts bytes."""
    data = bytearray(path.read_bytes())
    if path.name.endswith(".gz") and draw.random() < 0.8:
        return _compressed(path, draw)
    path.write_bytes(_changed(data, draw))


def _compressed(path: Path, draw: Draw) -> None:
    """The same inside a compressed file, so that the checksum is right."""
    try:
        data = bytearray(gzip.decompress(path.read_bytes()))
    except (OSError, EOFError, zlib.error):
        return
    path.write_bytes(gzip.compress(_changed(data, draw), 1))


def _changed(data: bytearray, draw: Draw) -> bytes:
    size = len(data)
    # A file's head decides more than its body.
    start = int(draw.integers(size + 1)) if draw.random() < 0.5 else int(draw.integers(min(size, 200) + 1))
    end = min(size, start + int(2 ** draw.uniform(0, 10)))
    match int(draw.integers(6)):
        case 0:
            for place in draw.integers(max(size, 1), size=int(2 ** draw.uniform(0, 6))):
                data[int(place) : int(place) + 1] = bytes([int(draw.integers(256))])
        case 1:
            del data[start:]
        case 2:
            data[start:start] = data[start:end]
        case 3:
            del data[start:end]
        case 4:
            data[start:start] = draw.bytes(int(2 ** draw.uniform(0, 8)))
        case _:
            data[start:end] = bytes(end - start)
    return bytes(data)


def _number(path: Path, draw: Draw) -> None:
    """Replaces a number in a text, or a byte where there is none."""
    data = path.read_bytes()
    found = list(_NUMBER.finditer(data))
    if not found or path.suffix not in (".json", ".txt", ".yaml", ".xml", ".ini"):
        return _bytes(path, draw)
    one = found[int(draw.integers(len(found)))]
    path.write_bytes(data[: one.start()] + _NUMBERS[int(draw.integers(len(_NUMBERS)))] + data[one.end() :])


def _structure(path: Path, draw: Draw) -> None:
    """Replaces, removes or repeats a value of a JSON file; a line of another text."""
    text = path.read_bytes()
    if path.suffix == ".json":
        try:
            content = json.loads(text)
        except ValueError:
            return
        places = list(_places(content))
        owner, key = places[int(draw.integers(len(places)))]
        match int(draw.integers(3)):
            case 0:
                owner[key] = _VALUES[int(draw.integers(len(_VALUES)))]
            case 1:
                del owner[key]
            case _ if isinstance(owner, list):
                owner.append(owner[key])
            case _:
                owner[f"{key}s"] = owner[key]
        path.write_text(json.dumps(content))
    elif path.suffix in (".txt", ".yaml", ".xml", ".ini"):
        lines = text.split(b"\n")
        place = int(draw.integers(len(lines)))
        lines[place : place + 1] = [[], [lines[place]] * 2, [b" ".join(lines)]][int(draw.integers(3))]
        path.write_bytes(b"\n".join(lines))
    else:
        _bytes(path, draw)


def _places(content: Any) -> Any:
    """Every value of a JSON document as its owner and key; the document itself has none."""
    pairs = content.items() if isinstance(content, dict) else enumerate(content) if isinstance(content, list) else ()
    for key, value in list(pairs):
        yield content, key
        yield from _places(value)


def _rename(path: Path, draw: Draw) -> None:
    """Gives a file another name, or now and then another ending."""
    ending = path.suffix if draw.random() < 0.9 else (".txt", ".json", ".png", ".mp4", "")[int(draw.integers(5))]
    target = path.with_name(_NAMES[int(draw.integers(len(_NAMES)))] + ending)
    if not target.exists():
        path.rename(target)


def _remove(path: Path, draw: Draw) -> None:
    """Removes a file, or empties it."""
    if draw.random() < 0.5:
        path.unlink()
    else:
        path.write_bytes(b"")


def _copy(path: Path, draw: Draw) -> None:
    """Puts a copy elsewhere: in a folder inside, or beside under another name."""
    inside = path.parent / ("more", "labels", ".ipynb_checkpoints", "__MACOSX")[int(draw.integers(4))]
    target = inside / path.name if draw.random() < 0.5 else path.with_name(f"copy_{path.name}")
    target.parent.mkdir(exist_ok=True)
    if not target.exists():
        shutil.copy(path, target)


# Texts and their structure are mutated more often than files are moved.
_MUTATIONS: tuple[Callable[[Path, Draw], None], ...] = (
    *(_bytes, _bytes),
    *(_number, _number),
    *(_structure, _structure),
    _rename,
    _remove,
    _copy,
)
