"""Reader of Label Studio's export `JSON`: boxes on images, or tracks through videos.

The ids of regions are not kept: the tracker tells objects of one class apart.
"""

import json
from collections.abc import Sequence
from pathlib import Path, PurePath
from typing import Any
from urllib.parse import parse_qs, unquote, urlsplit

import numpy as np

from graphrl_jax.perception.detector import Detection
from graphrl_jax.perception.importers.boxes import image_size, turned_box
from graphrl_jax.perception.importers.class_names import class_named
from graphrl_jax.perception.importers.images import IMAGE_ENDINGS
from graphrl_jax.perception.importers.key_frames import KeyFrame, by_frame, checked_length, track_boxes
from graphrl_jax.perception.importers.listings import ListedImage, file_name, listed_recordings
from graphrl_jax.perception.importers.recording import ImportFailure, Recording, Recordings, raw_text, read_text
from graphrl_jax.perception.importers.values import number, whole

_IMAGE_BOX, _VIDEO_BOX = "rectanglelabels", "videorectangle"
_NO_SHAPES = (
    "choices", "datetime", "number", "pairwise", "ranker", "rating", "relation", "taxonomy", "textarea",
    "timelinelabels",
)  # fmt: skip
"""Types of results that are no objects."""
_PICTURES = (*IMAGE_ENDINGS, ".webp", ".tif", ".tiff")
_TOP_LEFT = (0.0, 0.0)
_SIDES = ("x", "y", "width", "height")
_PERCENT = np.array([100.0, 100.0])


def label_studio_files(files: Sequence[Path]) -> list[Path]:
    """The JSON files that are Label Studio's: lists of tasks with annotations."""
    texts = {path: raw_text(path) for path in files}
    # JSON_MIN, which lacks the sizes, names the annotator; its reader says so.
    words = (b'"annotations"', b'"annotator"')
    return [path for path, text in texts.items() if text[:1] == b"[" and any(word in text for word in words)]


def read_label_studio(files: list[Path], class_names: Sequence[str], size: Sequence[int] | None = None) -> Recordings:
    """Yields a recording per video, then one per sequence of images in a folder.

    A task has `data`, which names its image or video, and `annotations` with a `result` each. Annotations that were
    cancelled, and tasks without another one, are left out; of several, the one with `ground_truth` counts. A result of
    type `rectanglelabels` is a box on an image, one of type `videorectangle` a track: `value` has its label,
    `framesCount`, and in `sequence` the key frames, whose `frame` counts from 1. An object whose key frame is not
    `enabled` is absent after it; else its box changes linearly, and the last one stays to the end. Boxes are `x`, `y`,
    `width`, `height` in percent of the image's sides, and `rotation` in degrees about the top left corner.

    Args:
      files: JSON files.
      class_names: class names of the object table.
      size: width and height in pixels of images, and of videos with turned boxes, that do not say it.

    Raises:
      ImportFailure: a file is not Label Studio's, holds other shapes, or several annotations of a task; an image is
        listed twice; a number, label or size is wrong or missing; see also `sequences`.
    """
    for path in files:
        images = []
        for index, task in enumerate(_content(path)):
            where = f"{path}: [{index}]"
            results = _results(task, where)
            if results is None:
                continue
            types = {result["type"] for result in results}
            if len(types) > 1:
                raise ImportFailure(f"{where}: holds {' and '.join(sorted(types))}; allowed: one of both")
            if _VIDEO_BOX in types:
                yield _video(path / f"task_{task.get('id', index)}", results, class_names, size, where)
            else:
                images.append(_listed(task, results, class_names, size, where))
        yield from listed_recordings(path, images)


def _content(path: Path) -> list[Any]:
    """The tasks of a file."""
    try:
        content = json.loads(read_text(path))
    except ImportFailure:
        raise
    except (ValueError, RecursionError) as error:
        raise ImportFailure(f"{path}: no JSON: {type(error).__name__} {error}") from None
    if not isinstance(content, list):
        raise ImportFailure(f"{path}: holds a {type(content).__name__}; allowed: a list of tasks")
    return content


def _field(entry: Any, name: str, kind: type, where: str) -> Any:
    """A field of an object of JSON, after a check of its type."""
    value = entry.get(name) if isinstance(entry, dict) else None
    if not isinstance(value, kind):
        found = "missing" if value is None else f"a {type(value).__name__}"
        raise ImportFailure(f"{where}: {name} is {found}; allowed: a {kind.__name__}, as in the export JSON")
    return value


def _results(task: Any, where: str) -> list[dict] | None:
    """The shapes of the annotation of a task that counts, None if none does."""
    annotations = [one for one in _field(task, "annotations", list, where) if not _said(one, "was_cancelled")]
    annotations = [one for one in annotations if _said(one, "ground_truth")] or annotations
    if len(annotations) > 1:
        raise ImportFailure(f"{where}: {len(annotations)} annotations; allowed: one, or one with ground_truth")
    if not annotations:
        return None
    results = []
    for index, result in enumerate(_field(annotations[0], "result", list, f"{where}: annotations")):
        kind = _field(result, "type", str, f"{where}: result[{index}]")
        if kind not in (_IMAGE_BOX, _VIDEO_BOX, *_NO_SHAPES):
            allowed = f"{_IMAGE_BOX}, {_VIDEO_BOX}"
            raise ImportFailure(f"{where}: result[{index}]: type is {kind!r}; allowed: {allowed}")
        results += [result] if kind not in _NO_SHAPES else []
    return results


def _said(entry: Any, name: str) -> bool:
    return isinstance(entry, dict) and entry.get(name) is True


def _listed(
    task: dict, results: list[dict], class_names: Sequence[str], asked: Sequence[int] | None, where: str
) -> ListedImage:
    """An image and the boxes in it."""
    detections = []
    for index, result in enumerate(results):
        place = f"{where}: box {index}"
        if result.get("image_rotation") not in (None, 0):
            raise ImportFailure(f"{place}: image_rotation is {result['image_rotation']!r}; allowed: 0")
        size = image_size(_own_size(result, place), asked, place)
        value = _field(result, "value", dict, place)
        class_id = _class_id(value, _IMAGE_BOX, class_names, place)
        detections += _detection(class_id, _percent(value, place), size, place)
    name = _image_name(_field(task, "data", dict, where), where)
    return ListedImage(name, str(name.parent), detections)


def _image_name(data: dict, where: str) -> PurePath:
    """The file of the image that a task's data name."""
    names = {_named_file(text) for text in data.values() if isinstance(text, str)}
    names = {name for name in names if name.suffix.lower() in _PICTURES}
    if len(names) != 1:
        raise ImportFailure(f"{where}: data name {len(names)} images; allowed: one")
    return names.pop()


def _named_file(text: str) -> PurePath:
    """The file of a path, of an address, or of Label Studio's own address of a local file."""
    address = urlsplit(text) if "://" in text or "?d=" in text else None
    if address is not None:
        text = parse_qs(address.query).get("d", [unquote(address.netloc + address.path)])[0]
    return file_name(text)


def _own_size(result: dict, where: str) -> list[float] | None:
    """Width and height of the image in pixels, as a result says it; None if it does not."""
    fields = ("original_width", "original_height")
    if all(result.get(field) is None for field in fields):
        return None
    return [number(result.get(field), f"{where}: {field}") for field in fields]


def _class_id(value: dict, field: str, class_names: Sequence[str], where: str) -> int:
    labels = _field(value, field, list, where)
    if len(labels) != 1:
        raise ImportFailure(f"{where}: {field} holds {len(labels)} labels; allowed: one")
    return class_named(labels[0], class_names, f"{where}: label")


def _percent(box: dict, where: str) -> np.ndarray:
    """x0, y0, w, h in percent, and the turn in degrees: (5,)."""
    sides = [number(box.get(field), f"{where}: {field}") for field in _SIDES]
    return np.array([*sides, number(box.get("rotation", 0), f"{where}: rotation")])


def _detection(class_id: int, percent: np.ndarray, size: np.ndarray, where: str) -> list[Detection]:
    """The detection of a box (5,) in percent, none if the box is empty."""
    pixels = np.concatenate([percent[:4] / 100 * np.tile(size, 2), percent[4:]])
    box = turned_box(pixels, _TOP_LEFT, size, where)
    return [Detection(class_id, box)] if box[2:].any() else []


def _video(
    source: Path, results: list[dict], class_names: Sequence[str], asked: Sequence[int] | None, where: str
) -> Recording:
    """The recording of a video; the annotator's frame rate, which its frames follow, is the recording's."""
    lengths: set[int] = set()
    durations: set[float] = set()
    found = []
    for index, result in enumerate(results):
        place = f"{where}: track {index}"
        value = _field(result, "value", dict, place)
        length = checked_length(number(value.get("framesCount"), f"{place}: framesCount"), f"{place}: framesCount")
        lengths.add(length)
        durations |= {number(value["duration"], f"{place}: duration")} if value.get("duration") else set()
        class_id = _class_id(value, "labels", class_names, place)
        keys = _keys(_field(value, "sequence", list, place), length, place)
        # Without turned boxes, shares of the sides do not depend on the size.
        turned = any(key.box[4] for key in keys)
        size = image_size(_own_size(result, place), asked, place) if turned else _PERCENT
        for frame, percent in track_boxes(keys, length).items():
            spot = f"{place}: frame {frame + 1}"
            found += [(frame, seen) for seen in _detection(class_id, percent, size, spot)]
    if len(lengths) > 1:
        raise ImportFailure(f"{where}: framesCount is {' and '.join(map(str, sorted(lengths)))}; allowed: one number")
    length = lengths.pop()
    rate = length / min(durations) if durations and min(durations) > 0 else None
    return Recording(source, detections=by_frame(found, length), frame_rate=rate)


def _keys(sequence: list[Any], length: int, where: str) -> list[KeyFrame]:
    """The key frames of a track."""
    keys = []
    for index, key in enumerate(sequence):
        place = f"{where}: sequence[{index}]"
        enabled = _field(key, "enabled", bool, place)
        frame = whole(number(key.get("frame"), f"{place}: frame"), f"{place}: frame", 1, length) - 1
        keys.append(KeyFrame(frame, _percent(key, place), True, enabled, place))
    return keys
