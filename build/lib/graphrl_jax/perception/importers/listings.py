"""Recordings of images that one file lists by name."""

from collections import Counter, defaultdict
from collections.abc import Iterable
from fractions import Fraction
from pathlib import Path, PurePath, PureWindowsPath
from typing import NamedTuple

from graphrl_jax.perception.detector import Detection
from graphrl_jax.perception.importers.recording import ImportFailure, Recording, Recordings, natural_key
from graphrl_jax.perception.importers.sequences import Frame, sequence_of, sequences


class ListedImage(NamedTuple):
    """An image that a file lists.

    Attributes:
      name: its file.
      group: folder, video or task; images of two groups are in two recordings.
      detections: the detections in it.
      number: number of its frame, None if its name tells it.
    """

    name: PurePath
    group: str
    detections: list[Detection]
    number: Fraction | None = None


def file_name(text: str) -> PurePath:
    """The file that a text names; exporters write paths of Windows, too."""
    return PurePath(PureWindowsPath(text).as_posix())


def listed_recordings(path: Path, images: Iterable[ListedImage]) -> Recordings:
    """Yields a recording per sequence of images in a group.

    Args:
      path: the file that lists the images.
      images: the images in any order.

    Raises:
      ImportFailure: an image is listed twice; see also `sequences` and `FrameSequence.with_gaps`.
    """
    groups: dict[str, list[ListedImage]] = defaultdict(list)
    for image in images:
        groups[image.group].append(image)
    for group in sorted(groups, key=lambda group: natural_key(PurePath(group))):
        try:
            yield from _recordings(path / group, groups[group])
        except ImportFailure as failure:
            raise ImportFailure(f"{path}: {failure}") from None


def _recordings(source: Path, images: list[ListedImage]) -> Recordings:
    """The recordings that images of a group form."""
    frames = [Frame(image.name, image.number) for image in images if image.number is not None]
    numbered = len(frames) == len(images)
    if numbered:  # all images may be of one video file
        frames = [Frame(frame.path / str(frame.number), frame.number) for frame in frames]
    names = [frame.path for frame in frames] if numbered else [image.name for image in images]
    found = {name: image.detections for name, image in zip(names, images, strict=True)}
    if len(found) < len(images):
        name = Counter(names).most_common(1)[0][0]
        raise ImportFailure(f"{name} is listed twice; allowed: one image for each file")
    all_sequences = [sequence_of(frames)] if numbered else sequences(names)
    for sequence in all_sequences:
        in_order, notes = sequence.with_gaps()
        detections = [[] if name is None else found[name] for name in in_order]
        yield Recording(sequence.source(source, all_sequences), detections=detections, notes=notes)
