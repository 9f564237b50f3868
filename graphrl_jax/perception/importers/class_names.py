"""Class names that come with labels: `data.yaml`, `classes.txt`, `obj.names` and the like."""

from collections.abc import Callable, Sequence
from pathlib import Path

import yaml

from graphrl_jax.perception.importers.recording import ImportFailure, read_text

TEXT_NAMES = ("classes.txt", "class_names.txt", "predefined_classes.txt", "labels.txt", "names.txt", "_darknet.labels")
_YAML_ENDINGS = (".yaml", ".yml")
_LABEL_FOLDERS = ("labels", "obj_train_data")
"""Folders of labels in a data set; class names lie beside them."""


def class_names_of(folder: Path, source: Path) -> tuple[Path, dict[int, str]] | None:
    """The file that names the classes of a folder's labels, and the names by number from 0; None if there is none.

    Looks in the folder and in those above it, up to the source or to the folder of the data set.

    Raises:
      ImportFailure: a file cannot be read, or two files in one folder differ.
    """
    return _first_names(folder, source, class_names_in)


def class_names_in(path: Path) -> dict[int, str] | None:
    """Class names of a file by number from 0, None if it holds none.

    Raises:
      ImportFailure: the file cannot be read.
    """
    lines = _lines_in(path, 0)
    if lines is not None:
        return lines
    if path.suffix.lower() not in _YAML_ENDINGS:
        return None
    try:
        # The base loader leaves all values texts, so that a class may be called "no".
        content = yaml.load(read_text(path), yaml.BaseLoader)
    except yaml.YAMLError as error:
        raise ImportFailure(f"{path}: no YAML: {' '.join(str(error).split())}") from None
    names = content.get("names") if isinstance(content, dict) else None
    return _by_number(names, path) if isinstance(names, list | dict) else None


def lines_of_names(folder: Path, source: Path) -> tuple[Path, dict[int, str]] | None:
    """The text file that names the classes of a folder's labels, and the names by line from 1; None if there is none.

    Looks where `class_names_of` does.

    Raises:
      ImportFailure: see `class_names_of`.
    """
    return _first_names(folder, source, lambda path: _lines_in(path, 1))


def numbered_names(names: Sequence[str]) -> tuple[Path, dict[int, str]]:
    """Names of the object table, numbered from 1, in the place of those that a file holds."""
    return Path("the object table"), dict(enumerate(names, 1))


def _first_names(
    folder: Path, source: Path, read: Callable[[Path], dict[int, str] | None]
) -> tuple[Path, dict[int, str]] | None:
    """The nearest file that names classes, and what is read from it."""
    for place in _places(folder, source):
        found = [(path, names) for path in sorted(place.iterdir()) if (names := read(path)) is not None]
        for path, names in found[1:]:
            if names != found[0][1]:
                raise ImportFailure(f"{found[0][0]} and {path} differ in their class names; allowed: the same names")
        if found:
            return found[0]
    return None


def _places(folder: Path, source: Path) -> list[Path]:
    """The folder and those above it that belong to its data set."""
    folder, source = folder.absolute(), source.absolute()
    above = [folder, *folder.parents]
    tops = [index for index, place in enumerate(above) if place == source]
    tops += [index + 1 for index, place in enumerate(above[:-1]) if place.name in _LABEL_FOLDERS][-1:]
    return above[: max(tops, default=0) + 1]


def _lines_in(path: Path, first: int) -> dict[int, str] | None:
    """The lines of a text file of class names, numbered from `first`; None if it is no such file."""
    if path.name.lower() not in TEXT_NAMES and path.suffix.lower() != ".names":
        return None
    return dict(enumerate((line.strip() for line in read_text(path).rstrip().splitlines()), first))


def _by_number(names: list | dict, path: Path) -> dict[int, str]:
    try:
        by_number = {
            int(number): name for number, name in (names.items() if isinstance(names, dict) else enumerate(names))
        }
    except ValueError:
        by_number = {}
    if not by_number or not all(isinstance(name, str) for name in by_number.values()):
        raise ImportFailure(f"{path}: names is {names!r}; allowed: a list of names, or names by number")
    return by_number


def class_id(number: int, named: tuple[Path, dict[int, str]] | None, class_names: Sequence[str], where: str) -> int:
    """Id of a label's class in the object table: the class of the same name, or the number itself without names.

    Raises:
      ImportFailure: the number has no name, or the table lacks the class.
    """
    if named is None:
        if number not in range(len(class_names)):
            raise ImportFailure(f"{where}: class {number}; allowed: 0 to {len(class_names) - 1}")
        return number
    path, names = named
    if number not in names:
        raise ImportFailure(f"{where}: class {number}; allowed: {', '.join(map(str, sorted(names)))}, named by {path}")
    if names[number] not in class_names:
        raise ImportFailure(
            f"{where}: class {number} is {names[number]!r} by {path}; allowed: {', '.join(class_names)}"
        )
    return class_names.index(names[number])


def class_named(name: object, class_names: Sequence[str], what: str) -> int:
    """Id of a class in the object table by its name.

    Raises:
      ImportFailure: the table lacks the class.
    """
    if name not in class_names:
        raise ImportFailure(f"{what} {name!r}; allowed: {', '.join(class_names)}")
    return class_names.index(str(name))
