"""A file of objects, for tasks that are known from recordings alone:

name = "drawer"
frame_rate = 10

[[objects]]
name = "gripper"
kind = "robot"

[[objects]]
name = "cup"
label = "mug"                 # as the detector or the labels call it
colour = [220, 40, 40]        # or its colour, for the detector by colours
"""

import difflib
import json
import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from graphrl_jax.graph import ObjectTable
from graphrl_jax.perception.colour_detector import RGB, ColourDetector, Look
from graphrl_jax.perception.detector import Detector

KINDS = ("robot", "fixture", "articulated", "free")
_FIELDS = ("name", "frame_rate", "objects")
_OBJECT_FIELDS = ("name", "kind", "label", "colour")


class ObjectsError(ValueError):
    """A file of objects cannot be used; the message is one sentence that names file and field."""


@dataclass(frozen=True)
class ObjectsFile:
    """The objects of a task that is known from recordings alone.

    Attributes:
      name: of the task.
      frame_rate: frames per second that recordings are resampled to.
      objects: the object in each node slot; class names are the labels.
      looks: colours of the classes; empty if none has one.
    """

    name: str
    frame_rate: float
    objects: ObjectTable
    looks: tuple[Look, ...] = ()

    def detector(self) -> Detector | None:
        """The detector by colours; None if the file has no colours."""
        return ColourDetector(self.looks, tolerance=40.0) if self.looks else None


def read_objects(path: Path) -> ObjectsFile:
    """Reads a file of objects.

    Raises:
      ObjectsError: the file is missing or no valid TOML, or a field is missing or unknown or has a value that is not
        allowed.
    """
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except FileNotFoundError:
        raise ObjectsError(f"{path} is missing") from None
    except OSError as error:
        raise ObjectsError(f"{path} cannot be read: {error.strerror}") from None
    except (UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise ObjectsError(f"{path} is not valid TOML: {' '.join(str(error).split())}") from None
    _refuse_unknown(content, _FIELDS, str(path))
    listed = content.get("objects")
    if not isinstance(listed, list) or not all(isinstance(one, dict) for one in listed):
        raise ObjectsError(f"{path}: objects is {listed!r}; allowed: one [[objects]] or more")
    rows = [_object(one, f"{path}: {_called(one, number)}") for number, one in enumerate(listed, start=1)]
    labels = list(dict.fromkeys(row["label"] for row in rows))
    flags = {kind: tuple(row["kind"] == kind for row in rows) for kind in KINDS}
    try:
        objects = ObjectTable(
            names=tuple(row["name"] for row in rows),
            class_ids=tuple(labels.index(row["label"]) for row in rows),
            is_robot=flags["robot"],
            class_names=tuple(labels),
            is_fixture=flags["fixture"],
            is_articulated=flags["articulated"],
        )
    except ValueError as error:
        raise ObjectsError(f"{path}: {error}") from None
    name = _text(content, "name", str(path))
    return ObjectsFile(name, _frame_rate(content.get("frame_rate"), path), objects, _looks(rows, labels, path))


def _refuse_unknown(found: Mapping[str, Any], known: tuple[str, ...], where: str) -> None:
    for field in found:
        if field not in known:
            meant = "".join(f" (did you mean {one}?)" for one in difflib.get_close_matches(field, known, n=1))
            raise ObjectsError(f"{where}: {field} is unknown{meant}; known fields: {', '.join(known)}")


def _text(found: Mapping[str, Any], field: str, where: str) -> str:
    value = found.get(field)
    if not isinstance(value, str) or not value.strip():
        raise ObjectsError(f"{where}: {field} is {value!r}; allowed: a text")
    return value


def _frame_rate(value: Any, path: Path) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value < math.inf:
        raise ObjectsError(f"{path}: frame_rate is {value!r}; allowed: a number above 0")
    return float(value)


def _called(found: Mapping[str, Any], number: int) -> str:
    """What messages call an object: its number from 1 and its name, if it has one."""
    name = found.get("name")
    return f"object {number} ({name})" if isinstance(name, str) and name.strip() else f"object {number}"


def _object(found: Mapping[str, Any], where: str) -> dict[str, Any]:
    """An object's fields, with defaults: free, labelled by its name, no colour."""
    _refuse_unknown(found, _OBJECT_FIELDS, where)
    name = _text(found, "name", where)
    kind = found.get("kind", "free")
    if kind not in KINDS:
        raise ObjectsError(f"{where}: kind is {kind!r}; allowed: {', '.join(KINDS)}")
    label = _text(found, "label", where) if "label" in found else name
    return {"name": name, "kind": kind, "label": label, "colour": _colour(found.get("colour"), where)}


def _colour(value: Any, where: str) -> RGB | None:
    if value is None:
        return None
    if not isinstance(value, list) or len(value) != 3 or not all(type(one) is int and 0 <= one <= 255 for one in value):
        raise ObjectsError(f"{where}: colour is {value!r}; allowed: red, green, blue from 0 to 255")
    red, green, blue = value
    return red, green, blue


def _looks(rows: list[dict[str, Any]], labels: list[str], path: Path) -> tuple[Look, ...]:
    """The colour of each label, if objects have colours; everything of a colour is one object."""
    coloured = {row["label"]: row["colour"] for row in rows if row["colour"] is not None}
    if not coloured:
        return ()
    for label in labels:
        if label not in coloured:
            raise ObjectsError(f"{path}: no object labelled {label!r} has a colour; allowed: all or none")
        if sum(row["label"] == label for row in rows) > 1:
            raise ObjectsError(f"{path}: two objects are labelled {label!r}; allowed with colours: one")
    if len(set(coloured.values())) < len(coloured):
        raise ObjectsError(f"{path}: two labels have the same colour; allowed: a colour each")
    return tuple(Look(labels.index(label), (colour,)) for label, colour in coloured.items())


TEMPLATE = """# Objects of a task, for `graphrl import --objects`.

# The task's name, and the frames per second that recordings are resampled to.
name = {name}
frame_rate = 10

# One entry per object. Fields:
#   name     what the object is called in tables and plots
#   kind     "robot"        the robot or a part of it
#            "fixture"      never moves, such as a goal region or a shelf
#            "articulated"  moves along a track of its own, such as a lid or a drawer
#            "free"         anything else (the default)
#   label    what the detector or the labels call it (default: its name)
#   colour   [red, green, blue] from 0 to 255, for videos in which every object has a colour of its own; all objects or
#            none, and without colours a video needs a trained detector (--weights)
{objects}"""
_ENTRY = """
[[objects]]
name = {name}
kind = "{kind}"  # {kinds}
# colour = [red, green, blue]
"""


def template(name: str, labels: list[str]) -> str:
    """A commented file of objects with these labels, all of them free; with examples if there are none.

    Raises:
      ValueError: a label is empty.
    """
    if not all(map(str.strip, labels)):
        raise ValueError(f"the labels are {', '.join(map(repr, labels))}; allowed: texts that are not empty")
    kinds = {label: "free" for label in labels} or {"gripper": "robot", "shelf": "fixture", "cup": "free"}
    listed = f"{', '.join(KINDS[:-1])} or {KINDS[-1]}"
    entries = [_ENTRY.format(name=_quoted(label), kind=kind, kinds=listed) for label, kind in kinds.items()]
    return TEMPLATE.format(name=_quoted(name), objects="".join(entries))


def _quoted(text: str) -> str:
    """A text as TOML writes it, whose basic strings have the escapes of JSON."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
