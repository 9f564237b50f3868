"""Recordings, the output of all readers; the files of a source and their text."""

import codecs
import os
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from fnmatch import fnmatch
from pathlib import Path, PurePath
from typing import NoReturn

import numpy as np

from graphrl_jax.perception.detector import Detection

SAME_RATE = 0.01
"""Frame rates that differ by at most this share are the same."""
_SYSTEM_FOLDERS = ("__macosx", "@eadir", "$recycle.bin", "system volume information")
_BYTE_ORDER_MARKS = {codecs.BOM_UTF8: "utf-8-sig", codecs.BOM_UTF16_LE: "utf-16", codecs.BOM_UTF16_BE: "utf-16"}


class ImportFailure(ValueError):
    """A source cannot be imported; the message names the file, and the line where there is one."""


@dataclass(frozen=True)
class Recording:
    """One demonstration as read from its source.

    Attributes:
      source: file or folder of the recording.
      frames: (T, H, W, 3) uint8, or None if the source has only boxes.
      detections: detections in every frame, or None if a detector has to find them.
      success: whether it reached the goal.
      frame_rate: frames per second, or None if the source does not contain it.
      notes: what was done to the recording.
      events: frame of each true event by name, or None if the source does not say it.
    """

    source: Path
    frames: np.ndarray | None = None
    detections: list[list[Detection]] | None = None
    success: bool = True
    frame_rate: float | None = None
    notes: tuple[str, ...] = ()
    events: Mapping[str, int] | None = None

    @property
    def length(self) -> int:
        """Number of frames."""
        return len(self.frames) if self.frames is not None else len(self.detections or [])


MOST_FRAMES = 500_000
"""Of a recording; files that say more are taken for damaged."""
Recordings = Iterator[Recording]
"""Recordings one at a time, so that a folder of videos need not fit into memory."""


def resampled(recording: Recording, frame_rate: float | None) -> Recording:
    """The recording at another frame rate, with its duration; as it is if either rate is unknown or both are the same.

    Args:
      recording: a recording.
      frame_rate: frames per second.
    """
    own, frames, found = recording.frame_rate, recording.frames, recording.detections
    shown = resampled_frames(recording.length, own, frame_rate)
    if shown is None:
        return recording
    events = recording.events
    if events is not None:  # an event is at the first frame shown that is not before it
        events = {name: min(int(np.searchsorted(shown, at)), len(shown) - 1) for name, at in events.items()}
    return replace(
        recording,
        frames=None if frames is None else frames[shown],
        detections=None if found is None else [found[index] for index in shown],
        frame_rate=frame_rate,
        notes=(*recording.notes, f"resampled from {own:g} to {frame_rate:g} frames per second"),
        events=events,
    )


def resampled_frames(length: int, own: float | None, frame_rate: float | None) -> np.ndarray | None:
    """Numbers of the frames that are shown at another frame rate: (T,) int; None if `resampled` leaves all as they are.

    Args:
      length: number of frames.
      own: frames per second, or None if they are unknown.
      frame_rate: frames per second that are asked for, or None.
    """
    if own is None or frame_rate is None or not length or same_rate(own, frame_rate):
        return None
    return frames_shown(np.arange(length) / own, length / own, frame_rate)


def frames_shown(times: np.ndarray, duration: float, frame_rate: float) -> np.ndarray:
    """Index of the frame that is shown at each instant of a frame rate: (max(1, duration x frame_rate),) int.

    Args:
      times: (T,) seconds at which frames begin; the first is 0.
      duration: seconds until the last frame ends.
      frame_rate: frames per second.
    """
    count = duration * frame_rate
    if not count <= MOST_FRAMES:
        raise ImportFailure(
            f"{duration:g} s are {count:.4g} frames at {frame_rate:g} per second; allowed: up to {MOST_FRAMES} frames"
        )
    instants = np.arange(max(1, round(count))) / frame_rate
    # Times are rounded, so a frame may begin a little after its instant.
    return np.searchsorted(times, instants + 0.1 / frame_rate, side="right") - 1


def same_rate(first: float, second: float) -> bool:
    """Whether two frame rates are the same but for rounding, such as 29.97 and 30."""
    return abs(first - second) <= SAME_RATE * max(first, second)


def files_of(source: Path, *endings: str) -> list[Path]:
    """Files with one of these endings, the source or files in it at any depth; sorted by the numbers in their names.

    Links are followed. Hidden files and folders, and those of operating systems, are left out.

    Raises:
      ImportFailure: a file is a link to nothing.
      OSError: a folder cannot be read.
    """
    files = [source] if source.is_file() else _files_below(source)
    return in_order(path for path in files if any(fnmatch(path.name.lower(), f"*{ending}") for ending in endings))


def _files_below(source: Path) -> list[Path]:
    found, visited = [], set()
    for folder, folders, names in os.walk(source, onerror=_raise, followlinks=True):
        real = os.path.realpath(folder)
        if real in visited:  # a link leads back
            folders.clear()
            continue
        visited.add(real)
        folders[:] = sorted(name for name in folders if name[0] != "." and name.lower() not in _SYSTEM_FOLDERS)
        found += [Path(folder, name) for name in names if name[0] != "."]
    return found


def _raise(error: OSError) -> NoReturn:
    raise error


def read_text(path: Path) -> str:
    """The text of a file in UTF-8 or, with a byte order mark, UTF-16.

    Raises:
      ImportFailure: the file cannot be read, or is no such text.
    """
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise ImportFailure(f"{path}: cannot be read: {error.strerror}") from None
    encoding = next((name for mark, name in _BYTE_ORDER_MARKS.items() if raw[: len(mark)] == mark), "utf-8")
    try:
        return raw.decode(encoding)
    except UnicodeDecodeError as error:
        raise ImportFailure(f"{path}: no text in {encoding.upper()}: {error.reason} at byte {error.start}") from None


def raw_text(path: Path) -> bytes:
    """The bytes of a text without its byte order mark and leading blanks, for a look at what it speaks of."""
    # UTF-16 has a zero beside every letter.
    raw = path.read_bytes().replace(b"\0", b"")
    mark = next((mark for mark in _BYTE_ORDER_MARKS if raw[: len(mark)] == mark), b"")
    return raw[len(mark) :].lstrip()


def folders_of(files: list[Path]) -> dict[Path, list[Path]]:
    """Files by folder; folders are sorted by the numbers in their names."""
    folders: dict[Path, list[Path]] = {}
    for path in files:
        folders.setdefault(path.parent, []).append(path)
    return {folder: folders[folder] for folder in in_order(folders)}


def in_order(paths: Iterable[Path]) -> list[Path]:
    """Paths sorted by the numbers in their names: 2 before 10."""
    return sorted(paths, key=natural_key)


def natural_key(path: PurePath) -> list[tuple[bool, int, str]]:
    """Key that sorts paths by the numbers in their names."""
    parts = re.split("([0-9]+)", str(path))
    return [(index % 2 == 1, int(part) if index % 2 else 0, part) for index, part in enumerate(parts)]
