"""Readers of ready-made boxes: YOLO's text labels, corner text files, COCO's JSON."""

import json
import re
from collections import defaultdict
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from graphrl_jax.demonstrations import BOX_RANGE
from graphrl_jax.perception.detector import Detection
from graphrl_jax.perception.importers.recording import ImportFailure, Recording, Recordings, folders_of, in_order

LineReader = Callable[[list[float], int, str], Detection]
"""Makes a detection from the numbers of a line, the line's index in the file (from 0) and its place for messages."""
# Above this many frames per file, the numbers in file names cannot be frame numbers.
_MOST_SPARSE = 20


def yolo_line(class_names: Sequence[str]) -> LineReader:
    """Reader of lines `class cx cy w h [confidence]`, in units of the image; classes are those of the object table."""

    def read(numbers: list[float], _: int, where: str) -> Detection:
        if len(numbers) not in (5, 6):
            raise ImportFailure(f"{where}: {len(numbers)} numbers; allowed: class cx cy w h [confidence]")
        if numbers[0] not in range(len(class_names)):
            raise ImportFailure(f"{where}: class {numbers[0]:g}; allowed: 0 to {len(class_names) - 1}")
        return Detection(int(numbers[0]), _checked(np.array(numbers[1:5], np.float32), where))

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
        return Detection(class_ids[row], _checked(np.concatenate([(low + high) / 2, high - low]), where))

    return read


def read_label_folders(files: list[Path], read: LineReader) -> Recordings:
    """Yields a recording per folder of text files, one file per frame.

    File names end in frame numbers. A number that is skipped is a frame without detections.
    """
    for folder, paths in folders_of(files).items():
        detections = []
        for path in _with_gaps(folder, paths):
            if path is None:
                detections.append([])
                continue
            lines = [line for line in path.read_text(errors="replace").splitlines() if line.strip()]
            detections.append(
                [read(_numbers(line, path, i), i, f"{path}, line {i + 1}") for i, line in enumerate(lines)]
            )
        # A line of zeros marks an object that was not seen.
        seen = [[detection for detection in frame if detection.box[2:].any()] for frame in detections]
        yield Recording(folder, detections=seen)


def read_coco(files: list[Path], class_names: Sequence[str]) -> Recordings:
    """Yields a recording per folder in COCO's `images`; frames are sorted by the numbers in their names.

    `annotations` hold `image_id`, `category_id` and `bbox` (x0, y0, w, h in pixels); `categories` name the classes.
    """
    for path in files:
        yield from _read_coco(path, class_names)


def _read_coco(path: Path, class_names: Sequence[str]) -> Recordings:
    try:
        content = json.loads(path.read_text())
        names = {category["id"]: category["name"] for category in content["categories"]}
        images = {image["id"]: image for image in content["images"]}
        annotations = list(content["annotations"])
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise ImportFailure(f"{path}: not COCO's JSON: {error}") from None
    found: dict[Any, list[Detection]] = defaultdict(list)
    for number, annotation in enumerate(annotations):
        where = f"{path}: annotations[{number}]"
        try:
            image, name = images[annotation["image_id"]], names[annotation["category_id"]]
            corner, extent = np.array(annotation["bbox"], float).reshape(2, 2)
            size = np.array([image["width"], image["height"]], float)
        except (KeyError, TypeError, ValueError) as error:
            raise ImportFailure(f"{where}: {type(error).__name__} {error}") from None
        if name not in class_names:
            raise ImportFailure(f"{where}: category {name!r}; allowed: {', '.join(class_names)}")
        box = np.concatenate([(corner + extent / 2) / size, extent / size])
        found[annotation["image_id"]].append(Detection(class_names.index(name), _checked(box, where)))
    folders: dict[Path, list[tuple[Path, Any]]] = defaultdict(list)
    for key, image in images.items():
        name = Path(str(image.get("file_name", key)))
        folders[name.parent].append((name, key))
    for folder in sorted(folders):
        keys = dict(folders[folder])
        yield Recording(path / folder, detections=[found[keys[name]] for name in in_order(keys)])


def _with_gaps(folder: Path, paths: list[Path]) -> list[Path | None]:
    """The file of each frame, None for skipped numbers; the files as they are if names lack a number of their own."""
    ends = [re.search(r"(\d+)$", path.stem) for path in paths]
    numbers = [int(end[1]) for end in ends if end]
    if len(set(numbers)) < len(paths):
        return list(paths)
    step = min(np.diff(numbers), default=1)
    frames = (numbers[-1] - numbers[0]) // step + 1
    if any((number - numbers[0]) % step for number in numbers) or frames > _MOST_SPARSE * len(paths):
        raise ImportFailure(
            f"{folder}: the files' numbers skip from {numbers[0]} to {numbers[-1]} in {len(paths)} files"
        )
    by_frame = dict(zip(((number - numbers[0]) // step for number in numbers), paths, strict=True))
    return [by_frame.get(frame) for frame in range(frames)]


def _numbers(line: str, path: Path, index: int) -> list[float]:
    try:
        return [float(word) for word in line.replace(",", " ").split()]
    except ValueError:
        raise ImportFailure(f"{path}, line {index + 1}: {line.strip()!r} is not a list of numbers") from None


def _checked(box: np.ndarray, where: str) -> np.ndarray:
    low, high = BOX_RANGE
    if not np.isfinite(box).all() or (box < low).any() or (box > high).any() or (box[2:] < 0).any():
        shown = ", ".join(f"{value:.4g}" for value in box)
        raise ImportFailure(
            f"{where}: the box (cx, cy, w, h) is {shown}; allowed: {low} to {high}, in units of the image"
        )
    return box.astype(np.float32)
