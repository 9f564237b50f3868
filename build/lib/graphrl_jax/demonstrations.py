"""Demonstrations and their file format. Plain numpy, host only."""

import math
import zipfile
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from graphrl_jax.graph import ObjectTable
from graphrl_jax.storage import write_arrays

VERSION = 1
BOX_RANGE = (-0.5, 1.5)
_MOST_FRAMES = 500_000

_TABLE_FIELDS = ("names", "class_ids", "is_robot", "class_names")
_REQUIRED = ("boxes", "mask", "lengths", "success", *_TABLE_FIELDS, "frame_rate", "source", "task")
_OPTIONAL = ("is_fixture", "is_articulated", "classes", "events", "event_names", "kinds", "frames")
_PER_DEMONSTRATION = ("boxes", "mask", "lengths", "success", "classes", "events", "kinds", "frames")


class DemonstrationError(ValueError):
    """Demonstrations or a file of them break the format; the message is one sentence that names the field."""


@dataclass(frozen=True, eq=False)
class Demonstrations:
    """A set of demonstrations of one task, padded to the longest.

    | field       | shape           | dtype   | meaning                                                          |
    |-------------|-----------------|---------|------------------------------------------------------------------|
    | boxes       | (B, T, N, 4)    | float32 | cx, cy, w, h in [0, 1], origin top left; -0.5 to 1.5 is accepted |
    | mask        | (B, T, N)       | bool    | the object is present; a masked slot may hold any finite box     |
    | lengths     | (B,)            | int32   | number of real frames, 1 to T; later frames are padding          |
    | success     | (B,)            | bool    | the demonstration solves the task                                |
    | objects     |                 |         | `ObjectTable`: the object in each of the N slots                 |
    | frame_rate  |                 | float   | frames per second                                                |
    | source      |                 | str     | origin of the demonstrations                                     |
    | task        |                 | str     | the task's registered name                                       |
    | classes     | (B, N) or None  | int32   | class of the object in each slot, if demonstrations differ in it |
    | events      | (B, E) or None  | int32   | frame of each true event, -1 for never                           |
    | event_names | (E,)            | str     | names of the events; empty without events                        |
    | kinds       | (B,) or None    | str     | kind of each demonstration, e.g. "success" or "one_target"       |
    | frames      | (B, T, H, W, 3) or None | uint8 | the images                                                   |

    Raises:
      DemonstrationError: a field has the wrong shape, dtype or value; the message names it.
    """

    boxes: np.ndarray
    mask: np.ndarray
    lengths: np.ndarray
    success: np.ndarray
    objects: ObjectTable
    frame_rate: float
    source: str
    task: str
    classes: np.ndarray | None = None
    events: np.ndarray | None = None
    event_names: tuple[str, ...] = ()
    kinds: np.ndarray | None = None
    frames: np.ndarray | None = None

    def __post_init__(self) -> None:
        _check_scalars(self)
        _check_arrays(self)
        _check_values(self)

    def __len__(self) -> int:
        """B, the number of demonstrations."""
        return len(self.lengths)

    @property
    def num_frames(self) -> int:
        """T, the padded number of frames."""
        return self.boxes.shape[1]

    def class_ids(self) -> np.ndarray:
        """Class of the object in each slot of each demonstration: (B, N) int32."""
        if self.classes is not None:
            return self.classes
        return np.tile(np.array(self.objects.class_ids, np.int32), (len(self), 1))

    def images(self, size: int) -> np.ndarray:
        """The images: (B, T, size, size, 3) uint8.

        Raises:
          DemonstrationError: there are no images, or they have another size.
        """
        if self.frames is None or self.frames.shape[2:4] != (size, size):
            found = (
                "none" if self.frames is None else f"those of {self.frames.shape[2]} x {self.frames.shape[3]} pixels"
            )
            raise DemonstrationError(f"frames must be images of {size} x {size} pixels, got {found}")
        return self.frames

    def select(self, indices: Sequence[int] | np.ndarray) -> "Demonstrations":
        """The demonstrations at `indices`, in that order; a boolean array of shape (B,) selects where it is True."""
        indices = np.asarray(indices)
        if indices.size == 0 or (indices.dtype == bool and not indices.any()):
            raise DemonstrationError("a selection of demonstrations must keep at least one, got none")
        chosen = {name: getattr(self, name) for name in _PER_DEMONSTRATION}
        return replace(self, **{name: None if value is None else value[indices] for name, value in chosen.items()})

    def successes(self) -> "Demonstrations":
        """The demonstrations that solve the task."""
        return self.select(self.success)

    def split(self, fraction: float, seed: int) -> tuple["Demonstrations", "Demonstrations"]:
        """A random split into the share `fraction` of the demonstrations and the rest, at least one each.

        Raises:
          DemonstrationError: `fraction` is not inside (0, 1) or there are fewer than two demonstrations.
        """
        first = drawn_share(len(self), fraction, seed)
        return self.select(first), self.select(~first)

    def resampled(self, frame_rate: float) -> "Demonstrations":
        """The same demonstrations at another frame rate; each keeps its first and last frame.

        Boxes are interpolated in time where the object is seen in both frames around; masks, other boxes and images are
        the nearest frame's.

        Raises:
          DemonstrationError: a demonstration would have more frames than any recording.
        """
        ratio = self.frame_rate / frame_rate
        longest = math.ceil((int(self.lengths.max()) - 1) / ratio) + 1
        if longest > _MOST_FRAMES:
            raise DemonstrationError(
                f"a demonstration at {self.frame_rate:g} frames per second has {longest} frames at {frame_rate:g}; "
                f"allowed: up to {_MOST_FRAMES}"
            )
        lengths = np.ceil((self.lengths - 1) / ratio).astype(np.int32) + 1
        times = np.minimum(np.arange(lengths.max()) * ratio, self.lengths[:, None] - 1)
        before, nearest = np.floor(times).astype(int), np.round(times).astype(int)
        after = np.minimum(before + 1, self.lengths[:, None] - 1)
        each = np.arange(len(self))[:, None]
        share = (times - before)[..., None, None].astype(np.float32)
        between = (1 - share) * self.boxes[each, before] + share * self.boxes[each, after]
        seen = self.mask[each, before] & self.mask[each, after]
        events = self.events
        if events is not None:
            events = np.where(events < 0, -1, np.ceil(events / ratio)).astype(events.dtype)
        return replace(
            self,
            boxes=np.where(seen[..., None], between, self.boxes[each, nearest]),
            mask=self.mask[each, nearest],
            lengths=lengths,
            frame_rate=frame_rate,
            source=f"{self.source}, resampled from {self.frame_rate:g} to {frame_rate:g} frames per second",
            events=events,
            frames=None if self.frames is None else self.frames[each, nearest],
        )

    def save(self, path: str | Path) -> None:
        """Writes one .npz file at exactly `path`, atomically. Missing folders are created."""
        entries: dict[str, Any] = {"version": np.int32(VERSION)}
        for field in fields(self):
            value = getattr(self, field.name)
            if field.name != "objects" and value is not None:
                entries[field.name] = value
        entries["event_names"] = _text_array(self.event_names)
        entries["names"] = _text_array(self.objects.names)
        entries["class_names"] = _text_array(self.objects.class_names)
        entries["class_ids"] = np.array(self.objects.class_ids, np.int32)
        entries["is_robot"] = np.array(self.objects.is_robot, bool)
        entries["is_fixture"] = np.array(self.objects.is_fixture, bool)
        entries["is_articulated"] = np.array(self.objects.is_articulated, bool)

        write_arrays(Path(path), entries)


def drawn_share(number: int, fraction: float, seed: int) -> np.ndarray:
    """Which of `number` things are in a random share of them, at least one and not all: (number,) bool.

    Raises:
      DemonstrationError: `fraction` is not inside (0, 1) or there are fewer than two things.
    """
    if not 0 < fraction < 1:
        raise DemonstrationError(f"the fraction of a split must lie between 0 and 1, got {fraction}")
    if number < 2:
        raise DemonstrationError(f"a split needs at least 2 demonstrations, got {number}")
    order = np.random.default_rng(seed).permutation(number)
    count = int(np.clip(round(fraction * number), 1, number - 1))
    return np.isin(np.arange(number), order[:count])


def load(path: str | Path) -> Demonstrations:
    """Reads a file written by `Demonstrations.save`.

    Raises:
      DemonstrationError: the file is missing, is not a demonstration file, or breaks the format; the message is one
        sentence that starts with the path and names the field.
    """
    path = Path(path)
    try:
        return _from_entries(_read_entries(path))
    except DemonstrationError as error:
        raise DemonstrationError(f"{path}: {error}") from error


def _text_array(texts: Sequence[str]) -> np.ndarray:
    """Strings as a unicode array; numpy would convert an empty list to floats."""
    return np.array(texts, dtype=np.str_) if len(texts) else np.empty((0,), dtype="<U1")


def _read_entries(path: Path) -> dict[str, np.ndarray]:
    """All arrays of an .npz file by name."""
    if not path.is_file():
        raise DemonstrationError("there is no such file")
    if not zipfile.is_zipfile(path):
        raise DemonstrationError("not an .npz file, or a truncated one")
    entries = {}
    name = "version"
    try:
        with np.load(path, allow_pickle=False) as archive:
            for name in archive.files:
                entries[name] = archive[name]
    except (OSError, ValueError, EOFError, KeyError, zipfile.BadZipFile, zlib.error) as error:
        raise DemonstrationError(f"field {name!r} cannot be read, the file is damaged ({error})") from error
    return entries


def _from_entries(entries: dict[str, np.ndarray]) -> Demonstrations:
    """Demonstrations from the arrays of a file, after a check of the version and the field names."""
    version = entries.pop("version", None)
    if version is None:
        raise DemonstrationError("field 'version' is missing")
    if version.shape != () or version.dtype.kind not in "iu" or version != VERSION:
        raise DemonstrationError(f"field 'version' is {version}, but this release reads version {VERSION} only")
    for name in _REQUIRED:
        if name not in entries:
            raise DemonstrationError(f"field {name!r} is missing")
    known = (*_REQUIRED, *_OPTIONAL)
    for name in entries:
        if name not in known:
            raise DemonstrationError(f"field {name!r} is unknown; the known ones are {', '.join(known)}")
    values: dict[str, Any] = dict(entries)
    for name in ("frame_rate", "source", "task"):
        if values[name].shape != ():
            raise DemonstrationError(f"{name} must be a single value, got shape {values[name].shape}")
        values[name] = values[name].item()
    for name in (*_TABLE_FIELDS, "is_fixture", "is_articulated", "event_names"):
        if name in values:
            if values[name].ndim != 1:
                raise DemonstrationError(f"{name} must have one axis, got shape {values[name].shape}")
            values[name] = tuple(values[name].tolist())
    try:
        table = {name: values.pop(name) for name in (*_TABLE_FIELDS, "is_fixture", "is_articulated") if name in values}
        objects = ObjectTable(**table)
    except ValueError as error:
        raise DemonstrationError(str(error)) from error
    return Demonstrations(objects=objects, **values)


def _check_arrays(demos: Demonstrations) -> None:
    """Checks that every array is present and has the right dtype and shape."""
    if not isinstance(demos.boxes, np.ndarray) or demos.boxes.ndim != 4:
        raise DemonstrationError(f"boxes must be an array of shape (B, T, N, 4), got shape {np.shape(demos.boxes)}")
    batch, time = demos.boxes.shape[:2]
    slots = demos.objects.num_slots
    if batch < 1 or time < 1:
        raise DemonstrationError(f"boxes must hold at least one demonstration and one frame, got {demos.boxes.shape}")
    expected: dict[str, tuple[type, tuple[int, ...]]] = {
        "boxes": (np.float32, (batch, time, slots, 4)),
        "mask": (np.bool_, (batch, time, slots)),
        "lengths": (np.int32, (batch,)),
        "success": (np.bool_, (batch,)),
        "classes": (np.int32, (batch, slots)),
        "events": (np.int32, (batch, len(demos.event_names))),
        "kinds": (np.str_, (batch,)),
        "frames": (np.uint8, (batch, time, *np.shape(demos.frames)[2:4], 3)),
    }
    for name, (kind, shape) in expected.items():
        value = getattr(demos, name)
        if value is None and name in _OPTIONAL:
            continue
        if not isinstance(value, np.ndarray):
            raise DemonstrationError(f"{name} must be a numpy array, got {type(value).__name__}")
        if not np.issubdtype(value.dtype, kind):
            raise DemonstrationError(f"{name} must have dtype {kind.__name__}, got {value.dtype}")
        if value.shape != shape:
            raise DemonstrationError(f"{name} must have shape {shape}, got {value.shape}")


def _check_values(demos: Demonstrations) -> None:
    """Checks that boxes, lengths, classes and events are in their ranges."""
    time = demos.num_frames
    for index, length in enumerate(demos.lengths):
        if not 1 <= length <= time:
            raise DemonstrationError(f"lengths[{index}] is {length}; allowed are 1 to {time}, the frames in boxes")
    # Masked slots and padding must be finite too: they are multiplied by zero later, and 0 x NaN is NaN.
    _reject(~np.isfinite(demos.boxes), demos.boxes, "allowed are finite numbers, also in masked slots and padding")
    real = (np.arange(time) < demos.lengths[:, None])[:, :, None] & demos.mask
    low, high = BOX_RANGE
    outside = (demos.boxes < low) | (demos.boxes > high)
    _reject(outside & real[..., None], demos.boxes, f"allowed are {low} to {high}, in units of the image")
    negative = demos.boxes < 0
    negative[..., :2] = False
    _reject(negative & real[..., None], demos.boxes, "widths and heights must not be negative")
    classes = demos.class_ids()
    outside = (classes < 0) | (classes >= demos.objects.num_classes)
    if outside.any():
        index, slot = np.argwhere(outside)[0]
        allowed = f"0 to {demos.objects.num_classes - 1}"
        raise DemonstrationError(f"classes[{index}, {slot}] is {classes[index, slot]}; allowed are {allowed}")
    if demos.events is not None:
        wrong = (demos.events < -1) | (demos.events >= demos.lengths[:, None])
        if wrong.any():
            index, event = np.argwhere(wrong)[0]
            raise DemonstrationError(
                f"events[{index}, {event}] ({demos.event_names[event]}) is {demos.events[index, event]}; allowed are "
                f"-1 for never and the frames 0 to {demos.lengths[index] - 1}"
            )


def _reject(wrong: np.ndarray, boxes: np.ndarray, allowed: str) -> None:
    """Raises for the first wrong entry of `boxes`, if there is one."""
    if wrong.any():
        where = tuple(int(index) for index in np.argwhere(wrong)[0])
        raise DemonstrationError(f"boxes[{', '.join(map(str, where))}] is {boxes[where]:.6g}; {allowed}")


def _check_scalars(demos: Demonstrations) -> None:
    """Checks the texts, the frame rate and the event names."""
    for name in ("source", "task"):
        if not isinstance(getattr(demos, name), str):
            raise DemonstrationError(f"{name} must be a text, got {getattr(demos, name)!r}")
    if not isinstance(demos.frame_rate, float | int) or not 0 < demos.frame_rate < float("inf"):
        raise DemonstrationError(f"frame_rate must be a positive number, got {demos.frame_rate!r}")
    names = demos.event_names
    if not isinstance(names, tuple) or not all(isinstance(name, str) for name in names):
        raise DemonstrationError(f"event_names must be a tuple of texts, got {names!r}")
    if names and demos.events is None:
        raise DemonstrationError(f"events is missing, but event_names lists {names}")


def reached_for_good(reached: np.ndarray, lengths: np.ndarray | None = None) -> np.ndarray:
    """First frame from which each event holds to the end of its demonstration, -1 if none.

    Args:
      reached: (B, T, E) bool, whether each event holds in each frame.
      lengths: (B,) number of frames of each demonstration, 1 to T; default: T.

    Returns:
      (B, E) int32.
    """
    count = reached.shape[1]
    if lengths is not None:
        # What follows a demonstration's last frame repeats it.
        frames = np.minimum(np.arange(count), np.asarray(lengths)[:, None] - 1)
        reached = np.take_along_axis(reached, frames[..., None], axis=1)
    not_yet = ~reached[:, ::-1]
    trailing = np.where(not_yet.any(1), np.argmax(not_yet, axis=1), count)
    return np.where(trailing > 0, count - trailing, -1).astype(np.int32)
