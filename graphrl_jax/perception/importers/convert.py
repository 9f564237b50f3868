"""Conversion of recordings to demonstrations: detection, tracking, padding."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from graphrl_jax.demonstrations import Demonstrations
from graphrl_jax.graph import ObjectTable
from graphrl_jax.perception.config import FORMATS
from graphrl_jax.perception.detector import Detector
from graphrl_jax.perception.importers import images, labels, magical
from graphrl_jax.perception.importers.recording import ImportFailure, Recording, Recordings, files_of
from graphrl_jax.perception.tracking import track

ENDINGS: dict[str, tuple[str, ...]] = {
    "magical": (".pkl.gz",),
    "video": images.VIDEO_ENDINGS,
    "frames": images.IMAGE_ENDINGS,
    "coco": (".json",),
    "yolo": (".txt",),
    "corners": (".txt",),
}


@dataclass(frozen=True)
class Source:
    """A source of recordings.

    Attributes:
      path: file or folder.
      format: one of `FORMATS`, or None to infer it from the file names.
      size: width and height of the images, which corner files do not contain.

    Raises:
      ImportFailure: the path is missing, the format is unknown or cannot be inferred, or the size is missing.
    """

    path: Path
    format: str | None = None
    size: tuple[int, int] | None = None

    def __post_init__(self) -> None:
        if not self.path.exists():
            raise ImportFailure(f"{self.path} is missing")
        if self.format is None:
            object.__setattr__(self, "format", guess_format(self.path))
        if self.format not in FORMATS:
            raise ImportFailure(f"unknown format {self.format!r}; known formats: {', '.join(FORMATS)}")
        if self.format == "corners" and self.size is None:
            raise ImportFailure("corner files are in pixels: the size of the images is missing")

    def recordings(self, objects: ObjectTable) -> Recordings:
        """The recordings, read one at a time."""
        files = files_of(self.path, *ENDINGS[str(self.format)])
        match self.format:
            case "magical":
                return magical.read_trajectories(files)
            case "video":
                return images.read_videos(files)
            case "frames":
                return images.read_frame_folders(files)
            case "coco":
                return labels.read_coco(files, objects.class_names)
            case "yolo":
                return labels.read_label_folders(files, labels.yolo_line(objects.class_names))
        assert self.size is not None
        return labels.read_label_folders(files, labels.corner_line(objects.class_ids, self.size))


def guess_format(path: Path) -> str:
    """The format of a source by its file names: the first match in `FORMATS`. Text files count as YOLO labels.

    Raises:
      ImportFailure: no file has a known format.
    """
    for name in FORMATS:
        if files_of(path, *ENDINGS[name]):
            return name
    raise ImportFailure(f"{path} holds nothing of a known format; known formats: {', '.join(FORMATS)}")


def track_recording(
    recording: Recording, objects: ObjectTable, detector: Detector | None
) -> tuple[np.ndarray, np.ndarray]:
    """Boxes (T, N, 4) and mask (T, N) of a recording: the detector's if it has images, else its own detections.

    Raises:
      ImportFailure: there are no frames, there are images but no detector, or no object was detected.
    """
    detections: Iterable = recording.detections or []
    length = len(recording.detections or ())
    if recording.frames is not None:
        if detector is None:
            raise ImportFailure(f"{recording.source}: images need a detector, and this task has none of its own")
        detections, length = map(detector.detect, recording.frames), len(recording.frames)
    if not length:
        raise ImportFailure(f"{recording.source}: no frames")
    boxes, mask = track(detections, objects)
    if not mask.any():
        raise ImportFailure(f"{recording.source}: none of the objects {', '.join(objects.names)} was seen in any frame")
    return boxes, mask


def demonstrations_of(
    tracks: list[tuple[np.ndarray, np.ndarray, bool]], objects: ObjectTable, frame_rate: float, task: str, source: str
) -> Demonstrations:
    """Demonstrations from tracks (boxes (T_b, N, 4), mask (T_b, N), success) of any lengths, padded to the longest.

    Raises:
      ImportFailure: there are no tracks.
    """
    if not tracks:
        raise ImportFailure(f"{source} holds no demonstrations")
    longest = max(len(boxes) for boxes, _, _ in tracks)

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
    )
