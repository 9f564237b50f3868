"""Reader of videos, by ffmpeg. Frames have the times at which the video shows them."""

import math
import re
import subprocess
import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np
from imageio_ffmpeg import get_ffmpeg_exe

from graphrl_jax.perception.importers.recording import (
    ImportFailure,
    Recording,
    Recordings,
    frames_shown,
    same_rate,
)

VIDEO_ENDINGS = (".mp4", ".gif", ".avi", ".mov", ".mkv", ".webm")
_LARGEST_RATIO = 1.6
"""A frame rate is constant if the longest step between frames is at most this many times the shortest."""
_MOST_REPEATED = 20
"""Frames of a varying rate are shown at most this many times on average."""
_SOUND_PACKET = 0.1
"""Longest packet of sound, in seconds."""


class _Report(NamedTuple):
    """What ffmpeg says of a video.

    Attributes:
      size: (height, width) of the upright frames.
      times: (T,) seconds at which frames begin; the first is 0.
      end: seconds at which the last frame ends, as far as the file says it.
      promised: seconds that the header promises; 0 if it promises nothing.
      reached: seconds of sound and images that the file holds.
      frame_rate: frames per second by the header; 0 if it says nothing.
    """

    size: tuple[int, int]
    times: np.ndarray
    end: float
    promised: float
    reached: float
    frame_rate: float


def read_videos(files: list[Path]) -> Recordings:
    """Yields a recording per video file; frames of a varying rate are resampled to a constant one.

    Raises:
      ImportFailure: a file is no video, has no frames, breaks off or steps back in time; the message names it.
    """
    for path in files:
        _refuse_short_file(path)
        raw, report = _decoded(path)
        if len(raw) != len(report.times) * math.prod(report.size) * 3:
            raise ImportFailure(f"{path}: the size of the frames changes; allowed: one size")
        frames = np.frombuffer(raw, np.uint8).reshape(-1, *report.size, 3)
        back = np.flatnonzero(np.diff(report.times) <= 0)
        if len(back):
            raise ImportFailure(f"{path}: time does not go on from frame {back[0]} to {back[0] + 1}")
        yield _at_constant_rate(path, frames, report)


def _at_constant_rate(path: Path, frames: np.ndarray, report: _Report) -> Recording:
    """The recording of a video's frames (T, H, W, 3) at the frame rate of their times."""
    steps = np.diff(report.times)
    typical = _typical(steps)
    duration = max(report.end, float(report.times[-1]) + typical)
    _refuse_cut(path, report, duration, typical)
    if not len(steps):
        return Recording(path, frames, frame_rate=report.frame_rate or None)
    lasting = np.diff(report.times, append=duration)
    if lasting.max() <= _LARGEST_RATIO * lasting.min():
        return Recording(path, frames, frame_rate=_header_rate(1 / float(lasting.mean()), report))
    count = len(report.times)
    rate = min(_header_rate(1 / typical, report), _MOST_REPEATED * count / duration)
    note = f"{count} frames of a varying rate resampled to {rate:g} frames per second"
    shown = frames_shown(report.times, duration, rate)
    return Recording(path, frames[shown], frame_rate=rate, notes=(note,))


def _typical(steps: np.ndarray) -> float:
    """Mean of the steps (T - 1,) that are about as long as their median, 0 without steps; times are rounded."""
    if not len(steps):
        return 0.0
    middle = np.median(steps)
    return float(steps[(steps <= _LARGEST_RATIO * middle) & (middle <= _LARGEST_RATIO * steps)].mean())


def _decoded(path: Path) -> tuple[bytes, _Report]:
    """The frames' bytes, RGB, and what ffmpeg reports."""
    # A second output copies all streams to nowhere: sound may outlast the images.
    command = [get_ffmpeg_exe(), "-hide_banner", "-nostdin", "-xerror", "-i", path.absolute(), "-map", "0:V:0"]
    command += ["-fps_mode", "passthrough", "-vf", "showinfo=checksum=0", "-pix_fmt", "rgb24", "-f", "rawvideo", "-"]
    command += ["-map", "0", "-c", "copy", "-copy_unknown", "-f", "null", "-"]
    with tempfile.TemporaryFile() as log:
        done = subprocess.run(command, stdout=subprocess.PIPE, stderr=log, stdin=subprocess.DEVNULL, check=False)
        log.seek(0)
        text = log.read().decode(errors="replace")
    shown = re.findall(r"pts:\s*(-?\d+) .*?duration:\s*(\d+) .*? s:(\d+)x(\d+)", text)
    promised = _clock(r"Duration: (\d+):(\d+):([\d.]+)", text)
    if done.returncode and shown:
        raise ImportFailure(
            f"{path}: the video breaks off or is damaged after {len(shown)} frames; its header promises {promised:g} s"
        )
    unit = re.search(r"config in time_base: (\d+)/(\d+), frame_rate: (\d+)/(\d+)", text)
    if unit is None or not shown:
        raise ImportFailure(f"{path}: no video that can be read: {complaint(text)}")
    second = int(unit[2]) / int(unit[1])
    first, (start, last, width, height) = int(shown[0][0]), shown[-1]
    return done.stdout, _Report(
        size=(int(height), int(width)),
        times=np.array([int(time) - first for time, *_ in shown]) / second,
        end=(int(start) + int(last) - first) / second,
        promised=promised,
        reached=_clock(r"time=(\d+):(\d+):([\d.]+)", text),
        frame_rate=int(unit[3]) / max(int(unit[4]), 1),
    )


def complaint(text: str) -> str:
    """What ffmpeg's log says is wrong."""
    said = [re.sub(r"^\[.*?\] ", "", line) for line in text.splitlines() if re.search("rror|nvalid", line)]
    return said[0] if said else "no frames"


def _clock(pattern: str, text: str) -> float:
    """Seconds of the last clock time, hours:minutes:seconds, that ffmpeg prints this way; 0 if there is none."""
    found = re.findall(pattern, text)
    return sum(float(part) * unit for part, unit in zip(found[-1], (3600, 60, 1), strict=True)) if found else 0.0


def _header_rate(rate: float, report: _Report) -> float:
    """The header's frame rate if it is that of the frames' times, which are rounded; else that of the times."""
    return report.frame_rate if same_rate(rate, report.frame_rate) else rate


def _refuse_cut(path: Path, report: _Report, duration: float, step: float) -> None:
    """Refuses a video that ends before the end that its header promises."""
    # The last packet of sound may have no duration.
    if max(duration, report.reached) + step / 2 + _SOUND_PACKET < report.promised:
        raise ImportFailure(
            f"{path}: the video breaks off: its header promises {report.promised:g} s, but its {len(report.times)} "
            f"frames end after {duration:g} s"
        )


def _refuse_short_file(path: Path) -> None:
    """Refuses GIF and AVI files that lack their end: ffmpeg does not report it."""
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(8)
        file.seek(max(0, size - 1024))
        end = file.read().rstrip(b"\0")
    if head[:3] == b"GIF" and end[-1:] != b";":
        raise ImportFailure(f"{path}: the video breaks off: the file lacks the mark of its end")
    promised = int.from_bytes(head[4:], "little") + 8
    if head[:4] == b"RIFF" and promised > size:
        raise ImportFailure(f"{path}: the video breaks off: its header promises {promised} bytes, the file has {size}")
