"""The classes of an export of labels, for a file of objects."""

from collections.abc import Sequence
from pathlib import Path

from graphrl_jax.perception.importers.class_names import class_names_in, class_names_of
from graphrl_jax.perception.importers.coco import coco_files, read_categories
from graphrl_jax.perception.importers.recording import ImportFailure, files_of

_ALLOWED = "a .yaml file with names, classes.txt, obj.names, COCO's .json, or a folder with one of these"


def read_classes(path: Path) -> list[str]:
    """Names of the classes of an export, in the order of YOLO's numbers or of COCO's list; each name once.

    Args:
      path: YOLO's .yaml with `names`, a text file of names such as `classes.txt` or `obj.names`, or COCO's .json with
        `categories`; or a folder: YOLO's files are looked for in it, COCO's at any depth.

    Raises:
      ImportFailure: the path is missing, cannot be read or names no classes, a name is empty, or files differ.
    """
    if not path.exists():
        raise ImportFailure(f"{path} is missing")
    place, names = _in_folder(path) if path.is_dir() else (path, _in_file(path))
    if not names:
        raise ImportFailure(f"{place} names no classes; allowed: {_ALLOWED}")
    for number, name in enumerate(names):
        if not name.strip():
            raise ImportFailure(f"{place}: the name of class {number} is {name!r}; allowed: a text")
    return list(dict.fromkeys(names))


def _in_file(path: Path) -> list[str]:
    """The names in a file; none if it is of no known kind."""
    if path.suffix.lower() == ".json":
        return read_categories(path)
    return _by_number(class_names_in(path) or {})


def _in_folder(folder: Path) -> tuple[Path, list[str]]:
    """The first file of a folder that names classes, and the names in it."""
    found = class_names_of(folder, folder)
    if found is not None:
        return found[0], _by_number(found[1])
    return _same_for_all([(path, read_categories(path)) for path in coco_files(files_of(folder, ".json"))], folder)


def _same_for_all(found: Sequence[tuple[Path, list[str]]], folder: Path) -> tuple[Path, list[str]]:
    """The first of several files and its names, which are those of all."""
    for path, names in found[1:]:
        if names != found[0][1]:
            raise ImportFailure(f"{found[0][0]} and {path} differ in their categories; allowed: the same names")
    return found[0] if found else (folder, [])


def _by_number(names: dict[int, str]) -> list[str]:
    return [names[number] for number in sorted(names)]
