"""Reader of text in the format of the MOT challenge: all boxes of a video in one file, `gt.txt` or `det.txt`.

The numbers of tracks are not kept: the tracker tells objects of one class apart.
"""

import configparser
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from graphrl_jax.perception.detector import Detection
from graphrl_jax.perception.importers.boxes import checked_box, checked_confidence, image_size
from graphrl_jax.perception.importers.class_names import class_id, lines_of_names, numbered_names
from graphrl_jax.perception.importers.key_frames import by_frame, checked_length
from graphrl_jax.perception.importers.recording import MOST_FRAMES, ImportFailure, Recording, Recordings, read_text
from graphrl_jax.perception.importers.values import text_number, whole

_TRUTH, _DETECTED = "gt.txt", "det.txt"
_FOLDERS = ("gt", "det")
_COLUMNS = (7, 9, 10)
_WITH_CLASS = 9
_SIDES = ("imWidth", "imHeight")
_TOLD = (*_SIDES, "seqLength", "frameRate")
_LEAST_PIXELS = 2
"""Labels of other formats, in shares of the image's sides, hold no number above this."""


class _Line(NamedTuple):
    """A line of a file.

    Attributes:
      frame: number of the frame, from 1.
      track: number of the object, -1 if it has none.
      box: (4,) left, top, width, height in pixels.
      counts: whether it counts.
      confidence: from 0 to 1.
      class_number: number of the class, None if it has none.
      where: place of the line, for messages.
    """

    frame: int
    track: int
    box: np.ndarray
    counts: bool
    confidence: float
    class_number: int | None
    where: str


class _Sequence(NamedTuple):
    """What `seqinfo.ini` says of a video, None where it does not: size in pixels, frames, frames per second."""

    size: list[float] | None
    length: int | None
    frame_rate: float | None


def mot_files(files: Sequence[Path]) -> list[Path]:
    """The text files that are in the format: those named `gt.txt` or `det.txt`, and those with such a first line."""
    return [path for path in files if path.name.lower() in (_TRUTH, _DETECTED) or _is_mot(path)]


def _is_mot(path: Path) -> bool:
    try:
        first = next((line for line in read_text(path).splitlines() if line.strip()), "")
        numbers = [float(word) for word in first.split(",")]
    except ValueError:  # ImportFailure is one
        return False
    whole_numbers = all(number.is_integer() for number in numbers[:2])
    return len(numbers) in _COLUMNS and whole_numbers and numbers[0] >= 1 and max(numbers[2:6]) > _LEAST_PIXELS


def read_mot(
    files: list[Path], source: Path, class_names: Sequence[str], size: Sequence[int] | None = None
) -> Recordings:
    """Yields a recording per file; `det.txt` is left out where the same sequence has `gt.txt`.

    A line is `frame, id, left, top, width, height, confidence[, class, visibility]`, or has ten numbers, of which the
    last three say nothing here. Frames count from 1, pixels too: the first one is (1, 1). In `gt.txt`, and where there
    are nine numbers, the confidence is a flag, and lines with 0 do not count; elsewhere -1 means that there is none.

    Classes count from 1. Their names are the lines of `labels.txt` beside the file, else those of the object table.
    Beside `labels.txt`, which CVAT and Datumaro write, pixels count from 0. `seqinfo.ini` in the folder of the sequence
    tells the size of the images, the number of frames and the frame rate. Without it, the last frame is that of a line.

    Args:
      files: text files.
      source: source of the import; class names may lie between it and a file.
      class_names: class names of the object table.
      size: width and height of the images of sequences without `seqinfo.ini`, in pixels.

    Raises:
      ImportFailure: a line is not in the format, names no class where there are several, or has an object that its
        frame has already; the size is missing; `seqinfo.ini` is wrong.
    """
    known = {_folder(path) for path in files if path.name.lower() == _TRUTH}
    for path in files:
        if path.name.lower() != _DETECTED or _folder(path) not in known:
            yield _recording(path, source, class_names, size)


def _folder(path: Path) -> Path:
    """The folder of a file's sequence."""
    return path.parent.parent if path.parent.name.lower() in _FOLDERS else path.parent


def _recording(path: Path, source: Path, class_names: Sequence[str], size: Sequence[int] | None) -> Recording:
    sequence = _sequence(_folder(path) / "seqinfo.ini")
    named = lines_of_names(path.parent, source)
    first_pixel = 1 if named is None else 0
    names = named or numbered_names(class_names)
    sides = image_size(sequence.size, size, str(path))
    lines = _lines(path, sequence.length or MOST_FRAMES)
    found = []
    for line in lines:
        if line.counts and line.box[2:].any():
            corner, extent = (line.box[:2] - first_pixel) / sides, line.box[2:] / sides
            box = checked_box(np.concatenate([corner + extent / 2, extent]), line.where)
            number = class_id(_class_number(line, len(names[1])), names, class_names, line.where)
            found.append((line.frame - 1, Detection(number, box, line.confidence)))
    length = sequence.length or max((line.frame for line in lines), default=0)
    return Recording(path, detections=by_frame(found, length), frame_rate=sequence.frame_rate)


def _class_number(line: _Line, classes: int) -> int:
    """The class of a line; the only one where the line says none."""
    if line.class_number is None and classes > 1:
        raise ImportFailure(f"{line.where}: says no class; allowed: a class in column 8 of 9, or one class in all")
    return 1 if line.class_number is None else line.class_number


def _lines(path: Path, length: int) -> list[_Line]:
    """The lines of a file, in its order."""
    lines = []
    seen: set[tuple[int, int]] = set()
    for index, text in enumerate(read_text(path).splitlines()):
        if text.strip():
            line = _line(text, path.name.lower() == _TRUTH, length, f"{path}, line {index + 1}")
            if line.counts and line.track >= 0:
                if (line.frame, line.track) in seen:
                    raise ImportFailure(f"{line.where}: id {line.track} is in frame {line.frame} twice; allowed: once")
                seen.add((line.frame, line.track))
            lines.append(line)
    return lines


def _line(text: str, truth: bool, length: int, where: str) -> _Line:
    """A line that is not empty; `truth` says whether the file is `gt.txt`."""
    words = text.split(",")
    if len(words) not in _COLUMNS:
        raise ImportFailure(f"{where}: {len(words)} numbers; allowed: 7, 9 or 10, with commas between them")
    numbers = [text_number(word.strip(), f"{where}: column {column}") for column, word in enumerate(words, 1)]
    frame, track = whole(numbers[0], f"{where}: frame", 1, length), whole(numbers[1], f"{where}: id", -1)
    classed = len(numbers) == _WITH_CLASS
    number = whole(numbers[7], f"{where}: class", -1) if classed else None
    flagged = truth or classed
    sure = flagged or numbers[6] == -1
    confidence = 1.0 if sure else checked_confidence(numbers[6], f"{where}: column 7")
    return _Line(frame, track, np.array(numbers[2:6]), not flagged or numbers[6] != 0, confidence, number, where)


def _sequence(path: Path) -> _Sequence:
    """What a `seqinfo.ini` says; nothing if there is none."""
    if not path.exists():
        return _Sequence(None, None, None)
    parser = configparser.ConfigParser(interpolation=None)
    try:
        parser.read_string(read_text(path))
        section = dict(parser.items("Sequence"))
    except configparser.Error as error:
        raise ImportFailure(f"{path}: no seqinfo.ini: {' '.join(str(error).split())}") from None
    # The parser makes names small.
    told = {name: text_number(section[name.lower()], f"{path}: {name}") for name in _TOLD if name.lower() in section}
    size = [told[name] for name in _SIDES if name in told]
    if len(size) == 1:
        raise ImportFailure(f"{path}: one of {' and '.join(_SIDES)} is missing; allowed: both or none")
    length, rate = told.get("seqLength"), told.get("frameRate")
    if rate is not None and rate <= 0:
        raise ImportFailure(f"{path}: frameRate is {rate:g}; allowed: numbers above 0")
    return _Sequence(size or None, None if length is None else checked_length(length, f"{path}: seqLength"), rate)
