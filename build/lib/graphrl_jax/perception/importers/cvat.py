"""Reader of CVAT's XML, version 1.1: boxes on images, or tracks through a video.

The numbers of tracks only count and are not kept: the tracker tells objects of one class apart.
"""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from graphrl_jax.perception.detector import Detection
from graphrl_jax.perception.importers.boxes import image_size, turned_box
from graphrl_jax.perception.importers.class_names import class_named
from graphrl_jax.perception.importers.key_frames import KeyFrame, by_frame, checked_length, track_boxes
from graphrl_jax.perception.importers.listings import ListedImage, file_name, listed_recordings
from graphrl_jax.perception.importers.recording import ImportFailure, Recording, Recordings, raw_text, read_text
from graphrl_jax.perception.importers.values import text_number, whole

_CORNERS = ("xtl", "ytl", "xbr", "ybr")
_CENTRE = (0.5, 0.5)
_NO_SHAPES = ("attribute", "tag")


def cvat_files(files: Sequence[Path]) -> list[Path]:
    """The XML files that are CVAT's: those that speak of annotations."""
    return [path for path in files if b"<annotations" in raw_text(path)]


def read_cvat(files: list[Path], class_names: Sequence[str], size: Sequence[int] | None = None) -> Recordings:
    """Yields a recording per sequence of images in a folder of a task, or per task whose boxes are in tracks.

    An `image` has `name`, `width`, `height` and, in a project, `task_id`. A `track` has the `label` of its boxes. A
    `box` has `xtl`, `ytl`, `xbr`, `ybr` in pixels, may have `rotation` in degrees about its centre, and has, in an
    image, its `label` and, in a track, `frame` and `outside`. From a box that is outside to the next one the object is
    absent. Between others the box changes linearly; the last one stays to the end of the task.

    Args:
      files: XML files.
      class_names: class names of the object table.
      size: width and height of the images of tasks that do not say it, in pixels.

    Raises:
      ImportFailure: a file is not CVAT's, declares a document type, or holds other shapes than boxes; an image is
        listed twice; a number, label or size is wrong or missing; see also `sequences`.
    """
    for path in files:
        root = _root(path)
        images, tracks = list(root.iterfind("image")), list(root.iterfind("track"))
        if images and tracks:
            raise ImportFailure(f"{path}: holds images and tracks; allowed: one of both")
        if images:
            yield from listed_recordings(path, [_listed(image, class_names, size, path) for image in images])
        else:
            yield from _recordings(path, _tasks(root, path), tracks, class_names, size)


def _root(path: Path) -> Element:
    text = read_text(path)
    # Entities could grow without bound, or name other files.
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise ImportFailure(f"{path}: declares a document type or an entity; allowed: XML without both")
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise ImportFailure(f"{path}: no XML: {error}") from None
    version = root.findtext("version", "1.1").strip()
    if root.tag != "annotations" or version != "1.1":
        raise ImportFailure(f"{path}: holds {root.tag!r} of version {version!r}; allowed: CVAT's 'annotations' of 1.1")
    return root


def _listed(image: Element, class_names: Sequence[str], asked: Sequence[int] | None, path: Path) -> ListedImage:
    """An image and the boxes in it."""
    name, task = image.get("name", ""), image.get("task_id")
    where = f"{path}: image {name!r}"
    own = [text_number(image.get(field), f"{where}: {field}") for field in ("width", "height")]
    size = image_size(own, asked, where)
    detections = []
    for index, box in enumerate(_boxes(image, where)):
        place = f"{where}: box {index}"
        class_id = class_named(box.get("label"), class_names, f"{place}: label")
        detections += _detection(class_id, _pixels(box, place), size, place)
    folder = str(file_name(name).parent)
    return ListedImage(file_name(name), folder if task is None else f"task_{task}/{folder}", detections)


def _boxes(parent: Element, where: str) -> list[Element]:
    """The boxes of an image or a track."""
    shapes = [shape for shape in parent if shape.tag not in _NO_SHAPES]
    others = [shape.tag for shape in shapes if shape.tag != "box"]
    if others:
        raise ImportFailure(f"{where}: holds a shape {others[0]!r}; allowed: box")
    return shapes


def _pixels(box: Element, where: str) -> np.ndarray:
    """x0, y0, w, h in pixels, and the turn in degrees: (5,)."""
    x0, y0, x1, y1 = (text_number(box.get(field), f"{where}: {field}") for field in _CORNERS)
    return np.array([x0, y0, x1 - x0, y1 - y0, text_number(box.get("rotation", "0"), f"{where}: rotation")])


def _detection(class_id: int, pixels: np.ndarray, size: np.ndarray, where: str) -> list[Detection]:
    """The detection of a box, none if the box is empty."""
    box = turned_box(pixels, _CENTRE, size, where)
    return [Detection(class_id, box)] if box[2:].any() else []


class _Task(NamedTuple):
    """A task whose boxes are in tracks.

    Attributes:
      source: what to call its recording.
      first: number of its first frame.
      step: from one frame's number to the next.
      length: number of frames.
      size: width and height of the images that the file says, None if it does not.
    """

    source: Path
    first: int
    step: int
    length: int
    size: list[float] | None

    def place(self, box: Element, where: str) -> int | None:
        """Index of a box's frame, from 0; None for the box that ends a track after the task's last frame."""
        frame = whole(text_number(box.get("frame"), f"{where}: frame"), f"{where}: frame")
        place, rest = divmod(frame - self.first, self.step)
        if place == self.length and not rest and box.get("outside") == "1":
            return None
        if rest or place not in range(self.length):
            last = self.first + self.step * (self.length - 1)
            step = f" in steps of {self.step}" if self.step > 1 else ""
            raise ImportFailure(f"{where}: frame is {frame}; allowed: {self.first} to {last}{step}, the task's frames")
        return place


def _tasks(root: Element, path: Path) -> dict[str | None, _Task]:
    """The tasks by id; the task or job of a file without a project has none."""
    alone = [*root.iterfind("meta/task"), *root.iterfind("meta/job")]
    listed = root.findall("meta/project/tasks/task")
    if alone and not listed:
        return {None: _task(alone[0], root, path, 0, f"{path}: meta")}
    if not listed:
        raise ImportFailure(f"{path}: meta holds no task, job or project; allowed: one of them")
    tasks: dict[str | None, _Task] = {}
    # Within a subset of a project, the frames of all tasks are counted on.
    offset, subset = 0, None
    for one in listed:
        offset, subset = 0 if one.findtext("subset") != subset else offset, one.findtext("subset")
        name = one.findtext("id")
        if name in tasks:
            raise ImportFailure(f"{path}: meta: task {name} is listed twice")
        task = tasks[name] = _task(one, root, path / f"task_{name}", offset, f"{path}: meta: task {name}")
        offset = task.first + task.step * task.length
    return tasks


def _task(task: Element, root: Element, source: Path, offset: int, where: str) -> _Task:
    """What `meta` says of a task or job."""
    start = whole(text_number(task.findtext("start_frame", "0"), f"{where}: start_frame"), f"{where}: start_frame")
    step = re.search("step *= *([1-9][0-9]*)", task.findtext("frame_filter", ""))
    length = checked_length(text_number(task.findtext("size"), f"{where}: size"), f"{where}: size")
    found = task.find("original_size")
    size = root.find("meta/original_size") if found is None else found
    sides = None
    if size is not None:
        sides = [text_number(size.findtext(side), f"{where}: {side} of original_size") for side in ("width", "height")]
    return _Task(source, offset + start, int(step[1]) if step else 1, length, sides)


def _recordings(
    path: Path,
    tasks: dict[str | None, _Task],
    tracks: list[Element],
    class_names: Sequence[str],
    size: Sequence[int] | None,
) -> Recordings:
    """The recording of each task."""
    found: dict[str | None, list[tuple[int, Detection]]] = {name: [] for name in tasks}
    sizes = {name: image_size(task.size, size, str(task.source)) for name, task in tasks.items()}
    for index, track in enumerate(tracks):
        where = f"{path}: track {track.get('id', index)}"
        name = track.get("task_id") if None not in tasks else None
        if name not in tasks:
            raise ImportFailure(f"{where}: task_id is {name!r}; allowed: {', '.join(map(str, tasks))}")
        class_id = class_named(track.get("label"), class_names, f"{where}: label")
        for frame, pixels in track_boxes(_keys(track, tasks[name], where), tasks[name].length).items():
            place = f"{where}: frame {tasks[name].first + tasks[name].step * frame}"
            found[name] += [(frame, seen) for seen in _detection(class_id, pixels, sizes[name], place)]
    for name, task in tasks.items():
        yield Recording(task.source, detections=by_frame(found[name], task.length))


def _keys(track: Element, task: _Task, where: str) -> list[KeyFrame]:
    """The boxes of a track: those that were drawn, and those that CVAT put between them."""
    keys = []
    for box in _boxes(track, where):
        frame, outside = task.place(box, where), box.get("outside")
        place = f"{where}: frame {box.get('frame')}"
        if outside not in ("0", "1"):
            raise ImportFailure(f"{place}: outside is {outside!r}; allowed: 0, 1")
        if frame is not None:
            seen = outside == "0"
            keys.append(KeyFrame(frame, _pixels(box, place), seen, seen, place))
    return keys
