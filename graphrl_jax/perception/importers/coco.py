"""Reader of COCO's JSON: boxes of many images in one file."""

import json
from collections.abc import Hashable, Iterable, Mapping, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from graphrl_jax.perception.detector import Detection
from graphrl_jax.perception.importers.boxes import box_of_points, checked_box, checked_confidence
from graphrl_jax.perception.importers.class_names import class_named
from graphrl_jax.perception.importers.datasets import json_object
from graphrl_jax.perception.importers.listings import ListedImage, file_name, listed_recordings
from graphrl_jax.perception.importers.recording import ImportFailure, Recordings, raw_text, read_text
from graphrl_jax.perception.importers.values import number


def coco_files(files: Sequence[Path]) -> list[Path]:
    """The JSON files that are COCO's: those that speak of images and annotations."""
    texts = {path: raw_text(path) for path in files}
    # Label Studio's JSON, which may hold both words as well, is a list.
    objects = {path: text for path, text in texts.items() if text[:1] != b"["}
    return [path for path, text in objects.items() if b'"images"' in text and b'"annotations"' in text]


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
        yield from listed_recordings(path, [_listed(key, image, found[key], path) for key, image in images.items()])


def read_categories(path: Path) -> list[str]:
    """Names of the categories of a file, in its order.

    Raises:
      ImportFailure: the file cannot be read, is no JSON, or has no categories with names.
    """
    return [category["name"] for category in _categories(json_object(read_text(path), str(path)), path)]


def _listed(key: Any, image: dict, detections: list[Detection], path: Path) -> ListedImage:
    """An image of the file's list."""
    name = file_name(str(image.get("file_name", key)))
    video, frame = image.get("video_id"), image.get("frame_id")
    group = str(name.parent) if video is None else f"video_{video}"
    return ListedImage(name, group, detections, None if frame is None else _whole(frame, path))


def _read_file(path: Path, class_names: Sequence[str]) -> tuple[dict[Any, dict], dict[Any, list[Detection]]]:
    """The images of a file and the detections in each, by the images' ids."""
    try:
        content = json.loads(read_text(path))
        categories = _categories(content, path)
        names = {key: one["name"] for key, one in _by_id(categories, f"{path}: categories").items()}
        images = _by_id(content["images"], f"{path}: images")
        annotations = [dict(annotation) for annotation in content["annotations"]]
    except ImportFailure:
        raise
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise ImportFailure(f"{path}: not COCO's JSON: {type(error).__name__} {error}") from None
    found: dict[Any, list[Detection]] = {key: [] for key in images}
    for index, annotation in enumerate(annotations):
        where = f"{path}: annotations[{index}]"
        if annotation.get("iscrowd") in (1, "1"):
            continue
        key = _key(annotation, "image_id", images, where)
        name = names[_key(annotation, "category_id", names, where)]
        class_id = class_named(name, class_names, f"{where}: category")
        box = _box(annotation, _size(images[key], where), where)
        confidence = checked_confidence(number(annotation.get("score", 1.0), f"{where}: score"), f"{where}: score")
        if box[2:].any():
            found[key].append(Detection(class_id, box, confidence))
    return images, found


def _categories(content: Any, path: Path) -> list[dict]:
    """The categories of a file, after a check that they have names."""
    listed = content.get("categories") if isinstance(content, dict) else None
    if not isinstance(listed, list):
        raise ImportFailure(
            f"{path}: not COCO's JSON: categories is of type {type(listed).__name__}; allowed: a list of categories"
        )
    for index, category in enumerate(listed):
        name = category.get("name") if isinstance(category, dict) else None
        if not isinstance(name, str):
            raise ImportFailure(f"{path}: categories[{index}]: name is {name!r}; allowed: a text")
    return listed


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
    size = [number(image.get(field), f"{where}: {field} of its image") for field in ("width", "height")]
    if not min(size) > 0:
        raise ImportFailure(f"{where}: width and height of its image are {size}; allowed: numbers above 0")
    return np.array(size)


def _box(annotation: dict, size: np.ndarray, where: str) -> np.ndarray:
    """The box of an annotation, or the one around its polygons: (4,) float32."""
    bbox, polygons = annotation.get("bbox") or [], annotation.get("segmentation") or []
    if not isinstance(bbox, list) or len(bbox) not in (0, 4):
        raise ImportFailure(f"{where}: bbox is {bbox!r}; allowed: x0, y0, w, h")
    numbers = np.array([number(value, f"{where}: bbox") for value in bbox])
    if len(bbox) and (numbers[2:].any() or not polygons):
        return checked_box(np.concatenate([(numbers[:2] + numbers[2:] / 2) / size, numbers[2:] / size]), where)
    if not isinstance(polygons, list) or not polygons:
        raise ImportFailure(f"{where}: bbox is missing, and segmentation holds no polygon; allowed: one of both")
    flat = polygons if not isinstance(polygons[0], list) else [value for polygon in polygons for value in polygon]
    if len(flat) % 2:
        raise ImportFailure(f"{where}: segmentation has {len(flat)} numbers; allowed: x0, y0, x1, y1, ...")
    points = np.array([number(value, f"{where}: segmentation") for value in flat]).reshape(-1, 2) / size
    return box_of_points(points.ravel(), where)


def _whole(value: Any, path: Path) -> Fraction:
    if isinstance(value, bool) or not isinstance(value, int):
        raise ImportFailure(f"{path}: frame_id is {value!r}; allowed: whole numbers")
    return Fraction(value)
