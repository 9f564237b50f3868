"""Frames of clips, stretches of longer files, one clip in memory at a time."""

import re
import subprocess
from collections.abc import Callable, Iterable, Iterator
from itertools import groupby, islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from imageio_ffmpeg import get_ffmpeg_exe, read_frames

from graphrl_jax.perception.importers.recording import ImportFailure
from graphrl_jax.perception.importers.videos import complaint


class Clip(NamedTuple):
    """A stretch of a file.

    Attributes:
      path: the file.
      start: number of its first frame in the file, from 0.
      stop: number of the frame after its last one.
    """

    path: Path
    start: int
    stop: int


def refuse_overlaps(clips: Iterable[Clip]) -> None:
    """Refuses clips that share frames, or that do not follow each other in their file.

    Raises:
      ImportFailure: see above.
    """
    ends: dict[Path, int] = {}
    for clip in clips:
        if clip.start < ends.get(clip.path, 0):
            raise ImportFailure(
                f"{clip.path}: an episode begins at frame {clip.start}, but the one before ends with frame "
                f"{ends[clip.path] - 1}; allowed: one after the other"
            )
        ends[clip.path] = clip.stop


def read_clips(
    clips: Iterable[Clip],
    size: tuple[int, int],
    stream: Callable[[Path], Iterator[Any]],
    decode: Callable[[Any, str], np.ndarray],
) -> Iterator[np.ndarray]:
    """Yields the frames (T, H, W, 3) uint8 of each clip, in the order of the clips, which must not overlap.

    Args:
      clips: clips; those of a file that come one after the other are read in one go.
      size: height and width of the frames.
      stream: yields the frames of a file, in a raw form.
      decode: makes a frame (H, W, 3) uint8 from its raw form; is told its place, for messages.

    Raises:
      ImportFailure: a file has too few frames, or a frame has another size.
    """
    for path, group in groupby(clips, key=lambda clip: clip.path):
        raw, position = stream(path), 0
        for clip in group:
            position += sum(1 for _ in islice(raw, clip.start - position))
            first, frames = position, None
            for one in islice(raw, clip.stop - clip.start):
                where = f"{path}: frame {position}"
                frame = _of_size(decode(one, where), size, where)
                if frames is None:
                    frames = np.empty((clip.stop - clip.start, *frame.shape), np.uint8)
                frames[position - first] = frame
                position += 1
            if frames is None or position < clip.stop:
                raise ImportFailure(
                    f"{path}: the frames break off after {position}; allowed: {clip.stop} or more, as the metadata say"
                )
            yield frames


def _of_size(frame: np.ndarray, size: tuple[int, int], where: str) -> np.ndarray:
    if frame.shape != (*size, 3):
        found = f"{frame.shape[1]} x {frame.shape[0]}"
        raise ImportFailure(f"{where} is {found}; allowed: {size[1]} x {size[0]}, as the metadata say")
    return frame


def video_frames(path: Path) -> Iterator[np.ndarray]:
    """Yields the frames (H, W, 3) uint8 of a video; a damaged one breaks off.

    Raises:
      ImportFailure: the file is no video.
    """
    frames = read_frames(path.absolute(), input_params=["-xerror"], output_params=_FIRST_VIDEO)
    try:
        width, height = next(frames)["size"]
        for raw in frames:
            yield np.frombuffer(raw, np.uint8).reshape(height, width, 3)
    except (OSError, RuntimeError, LookupError, ValueError) as error:
        raise ImportFailure(f"{path}: no video that can be read: {complaint(str(error))}") from None
    finally:
        frames.close()


_FIRST_VIDEO = ["-map", "0:V:0", "-fps_mode", "passthrough"]


def frame_times(path: Path) -> np.ndarray:
    """Times at which a video's frames are shown, by its index, without decoding: (T,) seconds, sorted.

    Raises:
      ImportFailure: the file is missing, is no video, or has no frames.
    """
    if not path.is_file():
        raise ImportFailure(f"{path} is missing")
    command = [get_ffmpeg_exe(), "-hide_banner", "-nostdin", "-copyts", "-i", path.absolute(), "-map", "0:V:0"]
    done = subprocess.run([*command, "-c", "copy", "-f", "framecrc", "-"], capture_output=True, check=False)
    text = done.stdout.decode(errors="replace")
    unit = re.search(r"^#tb 0: (\d+)/(\d+)", text, re.MULTILINE)
    shown = re.findall(r"^0, *-?\d+, *(-?\d+),", text, re.MULTILINE)
    if unit is None or not shown:
        raise ImportFailure(f"{path}: no video that can be read: {complaint(done.stderr.decode(errors='replace'))}")
    return np.sort(np.array(shown, np.int64)) * (int(unit[1]) / int(unit[2]))


def refuse_other_times(path: Path, frame_rate: float, count: int) -> int:
    """Refuses a video whose frame t is not shown at t / frame rate, or that has fewer frames than `count`.

    Returns:
      The number of its frames.

    Raises:
      ImportFailure: see above, and `frame_times`.
    """
    times = frame_times(path)
    off = np.flatnonzero(np.abs(times * frame_rate - np.arange(len(times))) >= 0.5)
    if len(off):
        raise ImportFailure(
            f"{path}: frame {off[0]} is shown at {times[off[0]]:g} s; allowed: {off[0] / frame_rate:g} s, at the "
            f"{frame_rate:g} frames per second of the metadata"
        )
    if len(times) < count:
        raise ImportFailure(f"{path}: it has {len(times)} frames; allowed: {count} or more, as the metadata say")
    return len(times)
