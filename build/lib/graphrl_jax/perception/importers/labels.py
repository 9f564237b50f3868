"""Readers of text files with ready-made boxes: YOLO's labels and corner files, one file per frame."""

import re
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from graphrl_jax.perception.detector import Detection
from graphrl_jax.perception.importers.boxes import box_of_points, checked_box, checked_confidence
from graphrl_jax.perception.importers.class_names import TEXT_NAMES, class_id, class_names_of
from graphrl_jax.perception.importers.images import IMAGE_ENDINGS
from graphrl_jax.perception.importers.recording import (
    ImportFailure,
    Recording,
    Recordings,
    folders_of,
    in_order,
    read_text,
)
from graphrl_jax.perception.importers.sequences import sequences

_POINT_RANGE = (-0.01, 1.01)
"""Points of polygons lie in the image, but for rounding; what lies outside is no point."""
LineReader = Callable[[list[float], int, str], Detection]
"""Makes a detection from the numbers of a line, the line's index in the file (from 0) and its place for messages."""


def yolo_line(class_names: Sequence[str], source: Path, folder: Path) -> LineReader:
    """Reader of lines `class cx cy w h [confidence]` or `class x0 y0 x1 y1 ... [confidence]`, in units of the image.

    Args:
      class_names: class names of the object table.
      source: source of the import.
      folder: folder of the label files; class names may lie between it and the source.
    """
    named = class_names_of(folder, source)

    def read(numbers: list[float], _: int, where: str) -> Detection:
        count = len(numbers)
        # Seven numbers may be a triangle, or a box with a confidence and a track.
        if count < 5 or count == 7:
            raise ImportFailure(
                f"{where}: {count} numbers; allowed: class cx cy w h [confidence], or class and a polygon of 4 points "
                "or more"
            )
        if not numbers[0].is_integer():
            raise ImportFailure(f"{where}: class {numbers[0]:g}; allowed: whole numbers")
        found = class_id(int(numbers[0]), named, class_names, where)
        confidence = 1.0
        if count % 2 == 0:
            confidence = checked_confidence(numbers.pop(), f"{where}: number {count}")
        box = numbers[1:]
        if len(box) == 4:
            return Detection(found, checked_box(np.array(box), where), confidence)
        low, high = _POINT_RANGE
        outside = [point for point in box if not low <= point <= high]
        if outside:
            raise ImportFailure(f"{where}: the polygon has a point at {outside[0]:g}; allowed: 0 to 1")
        return Detection(found, box_of_points(box, where), confidence)

    return read


def corner_line(class_ids: Sequence[int], size: tuple[int, int]) -> LineReader:
    """Reader of lines `x0 y0 x1 y1` in pixels of an image of `size` (width, height), one per object slot, in order.

    GraphIRL trains from such text files, one per frame; an object that is not seen has a line of zeros.
    """

    def read(numbers: list[float], row: int, where: str) -> Detection:
        if len(numbers) != 4:
            raise ImportFailure(f"{where}: {len(numbers)} numbers; allowed: x0 y0 x1 y1")
        if row >= len(class_ids):
            raise ImportFailure(f"{where}: more lines than the table's {len(class_ids)} objects")
        low, high = np.array(numbers[:2]) / size, np.array(numbers[2:]) / size
        return Detection(class_ids[row], checked_box(np.concatenate([(low + high) / 2, high - low]), where))

    return read


def label_files(files: Sequence[Path]) -> list[Path]:
    """The text files that hold labels: not class names, nor others without a number in the name or the first word."""
    return [path for path in files if path.name.lower() not in TEXT_NAMES and _holds_labels(path)]


def _holds_labels(path: Path) -> bool:
    if re.search("[0-9]", path.stem):
        return True
    try:
        words = read_text(path).split()
    except ImportFailure:
        return False
    return not words or _is_number(words[0])


def read_label_folders(files: list[Path], reader_of: Callable[[Path], LineReader]) -> Recordings:
    """Yields a recording per sequence of label files in a folder, one file per frame.

    A number that is skipped, and an image without a label file, is a frame without detections.

    Args:
      files: label files.
      reader_of: makes the reader of the lines of a folder's files.

    Raises:
      ImportFailure: see `sequences`, `FrameSequence.with_gaps` and the readers.
    """
    for folder, paths in folders_of(files).items():
        read, labels = reader_of(folder), set(paths)
        found = sequences([*paths, *_unlabelled(folder, paths)])
        for sequence in found:
            frames, notes = sequence.with_gaps()
            detections = [_detections(Path(path), read) if path in labels else [] for path in frames]
            yield Recording(sequence.source(folder, found), detections=detections, notes=notes)


def _unlabelled(folder: Path, labels: list[Path]) -> list[Path]:
    """Images without a label file, if all labels of a folder have their images beside them.

    Images are in the folder, or in a folder `images` in the place of `labels`.
    """
    parts = list(folder.parts)
    at = [index for index, part in enumerate(parts) if part == "labels"][-1:]
    stems = {path.stem for path in labels}
    for place in (folder, *(Path(*parts[:index], "images", *parts[index + 1 :]) for index in at)):
        images = {path.stem: path for path in in_order(place.glob("[!.]*")) if path.suffix.lower() in IMAGE_ENDINGS}
        if stems <= images.keys():
            return [path for stem, path in images.items() if stem not in stems and re.search("[0-9]", stem)]
    return []


def _detections(path: Path, read: LineReader) -> list[Detection]:
    found = []
    for index, line in enumerate(read_text(path).splitlines()):
        if line.strip():
            where = f"{path}, line {index + 1}"
            found.append(read(_numbers(line, where), index, where))
    # A line of zeros marks an object that was not seen.
    return [detection for detection in found if detection.box[2:].any()]


def _numbers(line: str, where: str) -> list[float]:
    words = line.split()
    words = [word.strip(",") for word in words] if len(words) > 1 else line.strip().split(",")
    if not all(_is_number(word) for word in words if word):
        raise ImportFailure(f"{where}: {line.strip()!r} is not a list of numbers")
    return [float(word) for word in words if word]


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True
