"""Reader of segmentation masks: a PNG per frame whose values are objects, as DAVIS and SAM 2 write them.

A value stands for one object, but only its class is kept: the tracker tells objects of one class apart.
"""

from collections.abc import Iterator, Sequence
from fnmatch import fnmatch
from pathlib import Path

import numpy as np
from PIL import Image
from scipy.ndimage import find_objects

from graphrl_jax.graph import ObjectTable
from graphrl_jax.perception.detector import Detection
from graphrl_jax.perception.importers.boxes import box_of_points
from graphrl_jax.perception.importers.class_names import class_id, lines_of_names, numbered_names
from graphrl_jax.perception.importers.recording import ImportFailure, Recording, Recordings, folders_of
from graphrl_jax.perception.importers.sequences import sequences

VOID = (254, 255)
"""Values of pixels that belong to nothing."""
_FOLDERS = ("annotations*", "mask", "masks", "*_mask", "*_masks")
_BACKGROUND = ("background", "_background_", "__background__")
_MOST_OBJECTS = 63
"""Above this, the values of a PNG look like shades of grey or colours."""
_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_GREY, _PALETTE = 0, 3
_GREY_BITS = (1, 8)
"""Pillow stretches the values of 2 and of 4 bits."""


def mask_files(files: Sequence[Path]) -> list[Path]:
    """The files below a folder whose name says that it holds masks."""
    return [path for path in files if any(fnmatch(part.lower(), name) for part in path.parts[:-1] for name in _FOLDERS)]


def first_mask(files: Sequence[Path]) -> Path | None:
    """The first PNG that looks like a mask: one channel with an object, and small values only.

    Of a folder, the files are looked at up to the first one that says something.
    """
    for paths in folders_of([path for path in files if path.suffix.lower() == ".png"]).values():
        for path in paths:
            try:
                values = np.unique(_values(path))
            except ImportFailure:
                break
            values = values[(values > 0) & ~np.isin(values, VOID)]
            if len(values):
                if values[-1] <= _MOST_OBJECTS:
                    return path
                break
    return None


def without_masks(files: Sequence[Path]) -> list[Path]:
    """The images that are not masks in a folder for masks."""
    folders = folders_of(mask_files(files)).values()
    found = {path for paths in folders if first_mask(paths) is not None for path in paths}
    return [path for path in files if path not in found]


def read_masks(files: list[Path], source: Path, objects: ObjectTable) -> Recordings:
    """Yields a recording per sequence of masks in a folder.

    A mask is a PNG with a palette, of which the indices count, or grey. Value 0 is the background, 254 and 255 are
    void. The names of the other values, of classes or of objects of the table, are the lines of `labels.txt` or
    `classes.txt` in the folder or above it, counted from 1, or from 0 if the first is `background`. Without such a
    file, value 1 is the first object of the table. A number that is skipped is a frame without detections.

    Args:
      files: PNG files.
      source: source of the import; names may lie between it and the files.
      objects: the object table.

    Raises:
      ImportFailure: a file is no mask, a value has no name, the masks of a recording differ in size, or a folder holds
        masks of a single object each; see also `sequences` and `FrameSequence.with_gaps`.
    """
    for folder, paths in folders_of(files).items():
        names = _names(folder, source, objects)
        found = sequences(paths)
        for sequence in found:
            frames, notes = sequence.with_gaps()
            masks = _masks([Path(path) for path in sequence.paths])
            detections = [[] if path is None else _detections(*next(masks), names, objects) for path in frames]
            yield Recording(sequence.source(folder, found), detections=detections, notes=notes)


def _names(folder: Path, source: Path, objects: ObjectTable) -> tuple[Path, dict[int, str]]:
    """The file that names the values, and the class of each value; the object table where there is no file."""
    classes = [objects.class_names[number] for number in objects.class_ids]
    path, names = lines_of_names(folder, source) or numbered_names(classes)
    by_object = dict(zip(objects.names, classes, strict=True))
    first = 1 if names.get(1, "").lower() in _BACKGROUND else 0
    # What is the name of a class is no name of an object.
    known = by_object | {name: name for name in objects.class_names}
    return path, {number - first: known.get(name, name) for number, name in names.items()}


def _masks(paths: list[Path]) -> Iterator[tuple[Path, np.ndarray]]:
    """The masks (H, W) of a recording, all of one size."""
    shape: tuple[int, ...] | None = None
    single = paths[0].parent.name.isdecimal() and len(paths[0].parent.name) == 3
    for path in paths:
        values = _values(path)
        shape = shape or values.shape
        if values.shape != shape:
            sizes = [f"{one[1]} x {one[0]}" for one in (values.shape, shape)]
            raise ImportFailure(f"{path}: the mask is {sizes[0]}, but the recording's first one {sizes[1]}")
        single = single and values.max() <= 1
        if single and path == paths[-1]:
            raise ImportFailure(
                f"{path.parent}: a folder of this name whose masks hold 1 alone may be a single object of a video; "
                "allowed: one mask per frame with a value for each object, or another name"
            )
        yield path, values


def _values(path: Path) -> np.ndarray:
    """The values of a mask (H, W) uint8."""
    try:
        with path.open("rb") as file:
            head = file.read(26)
        with Image.open(path) as image:
            values = np.asarray(image)
    except Exception as error:  # every format raises other types
        raise ImportFailure(f"{path}: no image that can be read: {error}") from None
    if head[:8] != _SIGNATURE:
        raise ImportFailure(f"{path}: no PNG, in which alone values are kept as they are")
    bits, kind = head[24:26]
    if kind != _PALETTE and (kind != _GREY or bits not in _GREY_BITS):
        raise ImportFailure(
            f"{path}: a PNG of colour type {kind} and {bits} bits; allowed: masks with a palette, or grey ones of 1 or "
            "8 bits"
        )
    return values.astype(np.uint8)


def _detections(
    path: Path, values: np.ndarray, names: tuple[Path, dict[int, str]], objects: ObjectTable
) -> list[Detection]:
    """The objects in a mask (H, W); a box ends after the last pixel."""
    height, width = values.shape
    found = []
    for value, place in enumerate(find_objects(values), 1):
        if place is None or value in VOID:
            continue
        rows, columns = place
        corners = [columns.start / width, rows.start / height, columns.stop / width, rows.stop / height]
        number = class_id(value, names, objects.class_names, str(path))
        found.append(Detection(number, box_of_points(corners, str(path))))
    return found
