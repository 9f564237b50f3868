"""Reader of COCO's JSON: boxes of many images in one file."""

import json
import math
from collections import Counter, defaultdict
from collections.abc import Hashable, Iterable, Mapping, Sequence
from fractions import Fraction
from pathlib import Path, PurePath, PureWindowsPath
from typing import Any

import numpy as np

from graphrl_jax.perception.detector import Detection
from graphrl_jax.perception.importers.boxes import box_of_points, checked_box, checked_confidence
from graphrl_jax.perception.importers.recording import ImportFailure, Recording, Recordings, natural_key, read_text
from graphrl_jax.perception.importers.sequences import Frame, sequence_of, sequences

_NO_NUMBER = Fraction(-1)
"""Stands for the number of an image without `frame_id`."""


def coco_files(files: Sequence[Path]) -> list[Path]:
    """The JSON files that are COCO's: those that speak of images and annotations."""
    # UTF-16 has a zero beside every letter.
    texts = {path: path.read_bytes().replace(b"\0", b"") for path in files}
    return [path for path, text in texts.items() if b'"images"' in text and b'"annotations"' in text]


def read_coco(files: list[Path], class_names: Sequence[str]) -> Recordings:
    """Yields a recording per sequence of `images` in a folder, or with the same `video_id` where images have one.

    An image has `id`, `file_name`, `width` and `height`, and may have its frame number, `frame_id`. `categories` name
    the classes. `annotations` hold `image_id`, `category_id`, and `bbox` (x0, y0, w, h in pixels) or polygons in
    `segmentation`; `score` is a confidence. Annotations with `iscrowd` are no objects.

    Raises:
      ImportFailure: a file is not COCO's, an id is listed twice, or an annotation is wrong; see also `sequences`.
    """
    for path in files:
        images, found = _read_file(path, class_names)
        groups: dict[str, list[tuple[Frame, Any]]] = defaultdict(list)
        for key, image in images.items():
            # Exporters write paths of Windows, too.
            name = PurePath(PureWindowsPath(str(image.get("file_name", key))).as_posix())
            video, number = image.get("video_id"), image.get("frame_id")
            group = str(name.parent) if video is None else f"video_{video}"
            groups[group].append((Frame(name, _NO_NUMBER if number is None else _whole(number, path)), key))
        for group in sorted(groups, key=lambda group: natural_key(PurePath(group))):
            yield from _recordings(path, group, groups[group], found)


def _recordings(path: Path, group: str, listed: list[tuple[Frame, Any]], found: Mapping[Any, list]) -> Recordings:
    """The recordings that images of a group form; `found` has the detections by image id."""
    numbered = all(frame.number is not _NO_NUMBER for frame, _ in listed)
    if numbered:  # all images may be of one video file
        listed = [(Frame(frame.path / str(frame.number), frame.number), key) for frame, key in listed]
    keys = {frame.path: key for frame, key in listed}
    try:
        if len(keys) < len(listed):
            name = Counter(frame.path for frame, _ in listed).most_common(1)[0][0]
            raise ImportFailure(f"{name} is listed twice; allowed: one image for each file")
        all_sequences = [sequence_of([frame for frame, _ in listed])] if numbered else sequences(list(keys))
        for sequence in all_sequences:
            frames, notes = sequence.with_gaps()
            detections = [[] if name is None else found[keys[name]] for name in frames]
            yield Recording(sequence.source(path / group, all_sequences), detections=detections, notes=notes)
    except ImportFailure as failure:
        raise ImportFailure(f"{path}: {failure}") from None


def _read_file(path: Path, class_names: Sequence[str]) -> tuple[dict[Any, dict], dict[Any, list[Detection]]]:
    """The images of a file and the detections in each, by the images' ids."""
    try:
        content = json.loads(read_text(path))
        names = {
            key: category["name"] for key, category in _by_id(content["categories"], f"{path}: categories").items()
        }
        images = _by_id(content["images"], f"{path}: images")
        annotations = [dict(annotation) for annotation in content["annotations"]]
    except ImportFailure:
        raise
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise ImportFailure(f"{path}: not COCO's JSON: {type(error).__name__} {error}") from None
    found: dict[Any, list[Detection]] = {key: [] for key in images}
    for number, annotation in enumerate(annotations):
        where = f"{path}: annotations[{number}]"
        if annotation.get("iscrowd") in (1, "1"):
            continue
        key = _key(annotation, "image_id", images, where)
        name = names[_key(annotation, "category_id", names, where)]
        if name not in class_names:
            raise ImportFailure(f"{where}: category {name!r}; allowed: {', '.join(class_names)}")
        box = _box(annotation, _size(images[key], where), where)
        confidence = checked_confidence(_number(annotation.get("score", 1.0), f"{where}: score"), f"{where}: score")
        if box[2:].any():
            found[key].append(Detection(class_names.index(name), box, confidence))
    return images, found


def _by_id(entries: Iterable[dict], what: str) -> dict[Any, dict]:
    by_id: dict[Any, dict] = {}
    for entry in entries:
        if entry["id"] in by_id:
            raise ImportFailure(f"{what}: id {entry['id']!r} is listed twice")
        by_id[entry["id"]] = entry
    return by_id


def _key(annotation: dict, field: str, known: Mapping[Any, Any], where: str) -> Any:
    """The id in a field of an annotation, after a check that it is known."""
    key = annotation.get(field)
    if not isinstance(key, Hashable) or key not in known:
        raise ImportFailure(f"{where}: {field} is {key!r}; allowed: the ids that the file lists")
    return key


def _size(image: dict, where: str) -> np.ndarray:
    """Width and height of an image: (2,)."""
    size = [_number(image.get(field), f"{where}: {field} of its image") for field in ("width", "height")]
    if not min(size) > 0:
        raise ImportFailure(f"{where}: width and height of its image are {size}; allowed: numbers above 0")
    return np.array(size)


def _box(annotation: dict, size: np.ndarray, where: str) -> np.ndarray:
    """The box of an annotation, or the one around its polygons: (4,) float32."""
    bbox, polygons = annotation.get("bbox") or [], annotation.get("segmentation") or []
    if not isinstance(bbox, list) or len(bbox) not in (0, 4):
        raise ImportFailure(f"{where}: bbox is {bbox!r}; allowed: x0, y0, w, h")
    numbers = np.array([_number(value, f"{where}: bbox") for value in bbox])
    if len(bbox) and (numbers[2:].any() or not polygons):
        return checked_box(np.concatenate([(numbers[:2] + numbers[2:] / 2) / size, numbers[2:] / size]), where)
    if not isinstance(polygons, list) or not polygons:
        raise ImportFailure(f"{where}: bbox is missing, and segmentation holds no polygon; allowed: one of both")
    flat = polygons if not isinstance(polygons[0], list) else [value for polygon in polygons for value in polygon]
    if len(flat) % 2:
        raise ImportFailure(f"{where}: segmentation has {len(flat)} numbers; allowed: x0, y0, x1, y1, ...")
    points = np.array([_number(value, f"{where}: segmentation") for value in flat]).reshape(-1, 2) / size
    return box_of_points(points.ravel(), where)


def _number(value: Any, what: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ImportFailure(f"{what} is {value!r}; allowed: finite numbers")
    return float(value)


def _whole(value: Any, path: Path) -> Fraction:
    if isinstance(value, bool) or not isinstance(value, int):
        raise ImportFailure(f"{path}: frame_id is {value!r}; allowed: whole numbers")
    return Fraction(value)
