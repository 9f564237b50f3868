"""Conversion of recordings to demonstrations: detection, tracking, padding."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from graphrl_jax.demonstrations import Demonstrations
from graphrl_jax.graph import ObjectTable
from graphrl_jax.perception.config import FORMATS
from graphrl_jax.perception.detector import Detector
from graphrl_jax.perception.importers import (
    coco,
    cvat,
    images,
    label_studio,
    labels,
    lerobot,
    magical,
    masks,
    mot,
    robomimic,
    videos,
)
from graphrl_jax.perception.importers.recording import (
    ImportFailure,
    Recording,
    Recordings,
    files_of,
    resampled,
    resampled_frames,
)
from graphrl_jax.perception.tracking import assign, bridge

ENDINGS: dict[str, tuple[str, ...]] = {
    "magical": (".pkl.gz",),
    "video": videos.VIDEO_ENDINGS,
    "frames": images.IMAGE_ENDINGS,
    "coco": (".json",),
    "yolo": (".txt",),
    "corners": (".txt",),
    "cvat": (".xml",),
    "mot": (".txt",),
    "label_studio": (".json",),
    "masks": (".png",),
    "lerobot": ("info.json",),
    "robomimic": (".hdf5", ".h5"),
}
_READY = ("coco", "yolo", "cvat", "mot", "label_studio", "masks", "lerobot")
"""Formats of files that say what the images or videos beside them hold."""


@dataclass(frozen=True)
class Source:
    """A source of recordings.

    Attributes:
      path: file or folder.
      format: one of `FORMATS`, or None to infer it from the files.
      size: width and height of the images, which corner files do not contain and other labels may lack.
      camera: camera to read of a LeRobotDataset or of robomimic's files; None takes the only one.

    Raises:
      ImportFailure: the path is missing, the format is unknown or cannot be inferred, or the size is missing or 0.
    """

    path: Path
    format: str | None = None
    size: tuple[int, int] | None = None
    camera: str | None = None

    def __post_init__(self) -> None:
        if not self.path.exists():
            raise ImportFailure(f"{self.path} is missing")
        if self.format is None:
            object.__setattr__(self, "format", guess_format(self.path))
        if self.format not in FORMATS:
            raise ImportFailure(f"unknown format {self.format!r}; known formats: {', '.join(FORMATS)}")
        if self.format == "corners" and self.size is None:
            raise ImportFailure("corner files are in pixels: the size of the images is missing")
        if self.size is not None and min(self.size) < 1:
            raise ImportFailure(f"the size of the images is {self.size[0]} x {self.size[1]}; allowed: 1 x 1 or more")

    def recordings(self, objects: ObjectTable) -> Recordings:
        """The recordings, read one at a time."""
        found = files_of(self.path, *ENDINGS[str(self.format)])
        # Where no file is of the format, its reader says what is wrong with the first.
        files = _of_format(str(self.format), found) or found
        match self.format:
            case "magical":
                return magical.read_trajectories(files)
            case "video":
                return videos.read_videos(files)
            case "frames":
                return images.read_frame_folders(files)
            case "coco":
                return coco.read_coco(files, objects.class_names)
            case "yolo":
                return labels.read_label_folders(files, partial(labels.yolo_line, objects.class_names, self.path))
            case "cvat":
                return cvat.read_cvat(files, objects.class_names, self.size)
            case "mot":
                return mot.read_mot(files, self.path, objects.class_names, self.size)
            case "label_studio":
                return label_studio.read_label_studio(files, objects.class_names, self.size)
            case "masks":
                return masks.read_masks(files, self.path, objects)
            case "lerobot":
                return lerobot.read_lerobot(files, self.camera)
            case "robomimic":
                return robomimic.read_robomimic(files, self.camera)
        assert self.size is not None
        read = labels.corner_line(objects.class_ids, self.size)
        return labels.read_label_folders(files, lambda _: read)


def _of_format(name: str, files: list[Path]) -> list[Path]:
    """The files that are of a format by their content or folder, where other files have the same ending."""
    match name:
        case "coco":
            return coco.coco_files(files)
        case "label_studio":
            return label_studio.label_studio_files(files)
        case "cvat":
            return cvat.cvat_files(files)
        case "mot":
            return mot.mot_files(files)
        case "yolo" | "corners":
            found = labels.label_files(files)
            others = set(mot.mot_files(found))
            return [path for path in found if path not in others]
        case "masks":
            return masks.mask_files(files)
        case "frames":
            return masks.without_masks(files)
        case "lerobot":
            return lerobot.info_files(files)
    return files


def guess_format(path: Path) -> str:
    """The format of a source by its files. Labels count before the images or videos beside them.

    Text files with one line per object count as YOLO labels. PNGs count as masks if they look like masks and are in a
    folder for masks.

    Raises:
      ImportFailure: no file has a known format, files have several, or it is unclear whether PNGs are masks.
    """
    by_ending = {name: files for name in FORMATS if name != "corners" and (files := files_of(path, *ENDINGS[name]))}
    found = [name for name, files in by_ending.items() if _of_format(name, files)]
    if "masks" in found and masks.first_mask(masks.mask_files(by_ending["masks"])) is None:
        found.remove("masks")
    if path.is_file() and not found:
        found = list(by_ending)[:1]
    if not found:
        raise ImportFailure(_nothing_in(path))
    told = [name for name in found if name in _READY] or found
    if len(told) > 1:
        raise ImportFailure(f"{path} holds {' and '.join(told)}; --format says which to read")
    unclear = masks.first_mask(by_ending["frames"]) if told == ["frames"] else None
    if unclear is not None:
        raise ImportFailure(f"{unclear} may be a frame or a mask; --format frames or --format masks says which")
    return told[0]


def _nothing_in(path: Path) -> str:
    """What is said of a source of no known format."""
    if path.suffix == ".npz":
        return f"{path} is a demonstration file; allowed: recordings, such as the videos that it was made of"
    if path.is_dir() and not any(path.iterdir()):
        return f"{path} is empty; allowed: a folder with recordings"
    return f"{path} holds nothing of a known format; known formats: {', '.join(FORMATS)}"


class Track(NamedTuple):
    """A recording at the asked frame rate, with its objects.

    Attributes:
      recording: the recording, of T frames.
      boxes: (T, N, 4) float32, boxes of its objects.
      mask: (T, N) bool, whether they were seen.
      notes: what tracking did.
      shown: (T,) int, number of the source's frame that each frame is.
      source_length: number of the source's frames.
      source_rate: the source's frames per second, or None if it does not say them.
    """

    recording: Recording
    boxes: np.ndarray
    mask: np.ndarray
    notes: tuple[str, ...]
    shown: np.ndarray
    source_length: int
    source_rate: float | None


def tracks_of(source: Source, objects: ObjectTable, detector: Detector, frame_rate: float | None) -> Iterator[Track]:
    """Reads the recordings of a source, one at a time, resamples them, and finds their objects.

    Raises:
      ImportFailure: see the reader of the format and `track_recording`.
    """
    for read in source.recordings(objects):
        recording = resampled(read, frame_rate)
        length, own = read.length, read.frame_rate
        shown = resampled_frames(length, own, frame_rate)
        shown = np.arange(length) if shown is None else shown
        yield Track(recording, *track_recording(recording, objects, detector), shown, length, own)


def track_recording(
    recording: Recording, objects: ObjectTable, detector: Detector
) -> tuple[np.ndarray, np.ndarray, tuple[str, ...]]:
    """Boxes (T, N, 4) and mask (T, N) of a recording, and notes on what tracking did to it.

    Boxes are the detector's if the recording has images, else its own detections.

    Raises:
      ImportFailure: there are no frames, or no object was detected.
      ValueError: there are images, and the detector is a `NoDetector`.
    """
    detections = recording.detections or []
    if recording.frames is not None:
        detections = [detector.detect(frame) for frame in recording.frames]
    if not detections:
        raise ImportFailure(f"{recording.source}: no frames")
    seen = assign(detections, objects)
    boxes, mask = bridge(seen)
    if not mask.any():
        raise ImportFailure(f"{recording.source}: none of the objects {', '.join(objects.names)} was seen in any frame")
    taken = int(np.sum(~np.isnan(seen[..., 0])))
    counts = {
        "boxes bridged over gaps": int(mask.sum()) - taken,
        "boxes dropped for want of a slot": sum(map(len, detections)) - taken,
    }
    return boxes, mask, tuple(f"{what}: {count}" for what, count in counts.items() if count)


def demonstrations_of(
    tracks: list[tuple[np.ndarray, np.ndarray, bool]],
    objects: ObjectTable,
    frame_rate: float,
    task: str,
    source: str,
    events: Sequence[Mapping[str, int] | None] = (),
) -> Demonstrations:
    """Demonstrations from tracks (boxes (T_b, N, 4), mask (T_b, N), success) of any lengths, padded to the longest.

    Args:
      tracks: one per demonstration.
      objects: the object table, of N slots.
      frame_rate: frames per second.
      task: the task's registered name.
      source: origin of the demonstrations.
      events: frames of the true events of each demonstration by name; left out if those of one are unknown.

    Raises:
      ImportFailure: there are no tracks.
    """
    if not tracks:
        raise ImportFailure(f"{source} holds no demonstrations")
    longest = max(len(boxes) for boxes, _, _ in tracks)

    names, frames = _event_frames(events, len(tracks))

    def padded(values: np.ndarray) -> np.ndarray:
        return np.pad(values, [(0, longest - len(values))] + [(0, 0)] * (values.ndim - 1))

    return Demonstrations(
        boxes=np.stack([padded(boxes) for boxes, _, _ in tracks]),
        mask=np.stack([padded(mask) for _, mask, _ in tracks]),
        lengths=np.array([len(boxes) for boxes, _, _ in tracks], np.int32),
        success=np.array([success for _, _, success in tracks]),
        objects=objects,
        frame_rate=frame_rate,
        source=source,
        task=task,
        events=frames,
        event_names=names,
    )


def _event_frames(events: Sequence[Mapping[str, int] | None], count: int) -> tuple[tuple[str, ...], np.ndarray | None]:
    """Names of all events, and the frame of each in each demonstration, -1 for never: (E,) and (B, E) int32."""
    known = [one for one in events if one is not None]
    names = tuple(dict.fromkeys(name for one in known for name in one))
    if not names or len(known) < count:
        return (), None
    return names, np.array([[one.get(name, -1) for name in names] for one in known], np.int32)
