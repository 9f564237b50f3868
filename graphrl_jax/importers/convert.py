"""Recordings to demonstrations: see, track, put together."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from graphrl_jax.demonstrations import Demonstrations
from graphrl_jax.detection import Detector
from graphrl_jax.graph import ObjectTable
from graphrl_jax.importers import labels, magical, pictures
from graphrl_jax.importers.recording import ImportFailure, Recording, Recordings, files_of
from graphrl_jax.tracking import track

ENDINGS = {
    "magical": (".pkl.gz",),
    "video": pictures.VIDEOS,
    "frames": pictures.PICTURES,
    "coco": (".json",),
    "yolo": (".txt",),
    "corners": (".txt",),
}
FORMATS = tuple(ENDINGS)


@dataclass(frozen=True)
class Source:
    """Where demonstrations come from.

    Attributes:
      path: file or folder.
      format: one of `FORMATS`, or None to tell by the names of the files.
      size: width and height of the pictures, which corner files do not say.

    Raises:
      ImportFailure: nothing is there, the format is unknown or cannot be told, or a size is missing.
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
            raise ImportFailure("corner files are in pixels: the size of the pictures is missing")

    def recordings(self, objects: ObjectTable) -> Recordings:
        """The recordings, read one at a time."""
        files = files_of(self.path, *ENDINGS[str(self.format)])
        match self.format:
            case "magical":
                return magical.read_trajectories(files)
            case "video":
                return pictures.read_videos(files)
            case "frames":
                return pictures.read_frame_folders(files)
            case "coco":
                return labels.read_coco(files, objects.class_names)
            case "yolo":
                return labels.read_label_folders(files, labels.yolo_line(objects.class_names))
        assert self.size is not None
        return labels.read_label_folders(files, labels.corner_line(objects.class_ids, self.size))


def guess_format(path: Path) -> str:
    """The format of a source by the names of its files, the first in `FORMATS` that is there. Text is taken for YOLO's.

    Raises:
      ImportFailure: no file there is of a known kind.
    """
    for name, endings in ENDINGS.items():
        if files_of(path, *endings):
            return name
    raise ImportFailure(f"{path} holds nothing of a known format; known formats: {', '.join(FORMATS)}")


def track_recording(
    recording: Recording, objects: ObjectTable, detector: Detector | None
) -> tuple[np.ndarray, np.ndarray]:
    """Boxes (T, N, 4) and mask (T, N) of a recording, seen by the detector unless it has detections already.

    Raises:
      ImportFailure: it has no frames, pictures and no detector, or nothing was seen in it.
    """
    detections: Iterable = recording.detections or []
    length = len(recording.detections or ())
    if recording.frames is not None:
        if detector is None:
            raise ImportFailure(f"{recording.source}: pictures need a detector, and this task has none of its own")
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
    """Tracks (boxes (T_b, N, 4), mask (T_b, N), success) of any lengths, padded and put together.

    Raises:
      ImportFailure: there are none.
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
