"""Which files form a recording, and in what order: told by the numbers in their names.

The number that runs through the names is the frame's. Other words and numbers tell recordings apart if the frame
numbers restart. Folder names, hashes, and dates beside a frame number decide nothing.
"""

import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import accumulate
from pathlib import Path, PurePath
from statistics import median
from typing import NamedTuple

from graphrl_jax.perception.importers.names import Name, read_names
from graphrl_jax.perception.importers.recording import ImportFailure, natural_key

_MOST_SPARSE = 20
"""Above this many frames per file, the numbers in file names cannot be frame numbers."""
_LARGEST_STEP = 2
"""Numbers run, as those of frames do, if their mean step is at most this."""
_LARGEST_RATIO = Fraction(5, 2)
"""Times are steady if the longest step is at most this many times the shortest."""
_SAME_STEP = Fraction(3, 2)
"""Steps of at most this many times the shortest one lead from a frame to the next."""


class Frame(NamedTuple):
    """A frame's file name and number."""

    path: PurePath
    number: Fraction


@dataclass(frozen=True)
class FrameSequence:
    """The frames of one recording, in the order of time.

    Attributes:
      frames: names and increasing numbers.
    """

    frames: tuple[Frame, ...]

    @property
    def paths(self) -> list[PurePath]:
        """Names of the frames."""
        return [frame.path for frame in self.frames]

    def source(self, folder: Path, all_sequences: Sequence["FrameSequence"]) -> Path:
        """What to call the recording: its folder, or its first file if the folder holds several recordings."""
        return folder if len(all_sequences) == 1 else folder / self.frames[0].path.name

    def with_gaps(self) -> tuple[list[PurePath | None], tuple[str, ...]]:
        """The name of every frame, None for a skipped number, and notes on steps and gaps.

        Raises:
          ImportFailure: the numbers skip too much to be those of frames.
        """
        numbers = [frame.number for frame in self.frames]
        most = _MOST_SPARSE * len(numbers)
        steps = _steps(numbers)
        step = _common_step(steps)
        if sum(steps) >= step * most:
            # The clock of a camera keeps no exact step.
            step = median(one for one in steps if one <= _SAME_STEP * min(steps))
        places = list(accumulate((round(one / step) for one in steps), initial=0))
        if places[-1] >= most:
            raise ImportFailure(
                f"{self.frames[0].path} to {self.frames[-1].path.name}: the files' numbers skip from "
                f"{_shown(numbers[0])} to {_shown(numbers[-1])} in {len(numbers)} files; allowed: at most "
                f"{_MOST_SPARSE} frames for each file"
            )
        by_place = dict(zip(places, self.paths, strict=True))
        gaps = places[-1] + 1 - len(places)
        notes = [f"step between numbers: {_shown(step)}"] if step != 1 else []
        notes += [f"numbers skipped, as frames in which nothing was seen: {gaps}"] if gaps else []
        return [by_place.get(place) for place in range(places[-1] + 1)], tuple(notes)


class _Family(NamedTuple):
    """Names with the same words.

    Attributes:
      names: the names.
      column: index of the frame's number in `Name.numbers`.
      rivals: columns that run as well.
    """

    names: list[Name]
    column: int
    rivals: list[int]

    def frames(self) -> list[Frame]:
        """All frames by number."""
        return sorted((Frame(name.path, name.numbers[self.column]) for name in self.names), key=_number)

    def recordings(self) -> list[list[Frame]]:
        """The frames of each recording by number: one recording, or several if numbers restart."""
        frames, parts = self.frames(), self.parts()
        # A frame alone is no recording: its number repeats.
        if _distinct(frames) or min(map(len, parts)) == 1:
            return [frames]
        return [_Family(part, self.column, []).frames() for part in parts]

    def parts(self) -> list[list[Name]]:
        """The names by the numbers and hashes beside the frame's number."""
        parts: dict[tuple, list[Name]] = defaultdict(list)
        for name in self.names:
            parts[name.numbers[: self.column], name.numbers[self.column + 1 :], name.hashes].append(name)
        return list(parts.values())


def sequences(paths: Sequence[PurePath]) -> list[FrameSequence]:
    """The recordings that files of one folder form, in the order of their first names.

    Raises:
      ImportFailure: a name holds no number, two frames of a recording have the same one, or it is unclear which number
        is the frame's or where a recording ends. The message names the files.
    """
    if len(paths) == 1:
        return [sequence_of([Frame(paths[0], Fraction(0))])]
    for name in read_names(paths, timed=False):
        if not name.numbers:
            raise ImportFailure(f"{name.path}: the name holds no frame number; allowed: names such as frame_1")
    families = _families(paths)
    for family in families:
        _refuse_disagreement(family)
        _refuse_continued(family)
    recordings = [recording for family in families for recording in family.recordings()]
    _refuse_lone_frames(recordings)
    _refuse_one_run(recordings)
    found = [sequence_of(recording) for recording in recordings]
    return sorted(found, key=lambda sequence: natural_key(sequence.frames[0].path))


def sequence_of(frames: Sequence[Frame]) -> FrameSequence:
    """The recording that frames form.

    Raises:
      ImportFailure: two frames have the same number.
    """
    frames = sorted(frames, key=_number)
    for before, after in zip(frames[:-1], frames[1:], strict=True):
        if before.number == after.number:
            raise ImportFailure(f"{before.path} and {after.path}: both are frame {_shown(after.number)}")
    return FrameSequence(tuple(frames))


def _families(paths: Sequence[PurePath]) -> list[_Family]:
    """The names by their words, with digits read as times where integers would make no sense."""
    counted, timed = _by_words(read_names(paths, timed=False)), _by_words(read_names(paths, timed=True))
    if len(timed) != len(counted):
        return min(timed, counted, key=len)
    steady = all(_steady(recording) for family in timed for recording in family.recordings())
    counts = all(_runs(recording) for family in counted for recording in family.recordings())
    return timed if steady or not counts else counted


def _by_words(names: Sequence[Name]) -> list[_Family]:
    by_words: dict[str, list[Name]] = defaultdict(list)
    for name in names:
        by_words[name.words].append(name)
    return [_family(family) for family in by_words.values()]


def _family(names: list[Name]) -> _Family:
    """Finds the number of the frame among the numbers of names with the same words."""
    kinds = ["time" if "time" in column else column[0] for column in zip(*(name.kinds for name in names), strict=True)]
    columns = [[Frame(name.path, name.numbers[index]) for name in names] for index in range(len(kinds))]
    varying = [index for index, column in enumerate(columns) if len({frame.number for frame in column}) > 1]
    after_word = [index for index in varying if kinds[index] == "frame"]
    if after_word or not varying:
        return _Family(names, after_word[-1] if after_word else 0, [])
    distinct = [index for index in varying if _distinct(columns[index])]
    running = [index for index in distinct if kinds[index] == "count" and _runs(columns[index])]
    if running or distinct:
        return _Family(names, (running or distinct)[-1], running or distinct)
    # Of a time and a count that both repeat, the one with more values is the frame's.
    values = {index: len({frame.number for frame in columns[index]}) for index in varying}
    latest = {kinds[index]: index for index in varying}
    return _Family(names, max(latest.values(), key=lambda index: (values[index], kinds[index] == "count")), [])


def _refuse_disagreement(family: _Family) -> None:
    """Refuses names in which one number steps back while another runs on."""
    names = sorted(family.names, key=lambda name: name.numbers[family.column])
    for rival in family.rivals:
        for before, after in zip(names[:-1], names[1:], strict=True):
            if before.numbers[rival] > after.numbers[rival]:
                raise ImportFailure(
                    f"{before.path} and {after.path}: a number steps back from {_shown(before.numbers[rival])} to "
                    f"{_shown(after.numbers[rival])} while another one runs on; allowed: one running number"
                )


def _refuse_continued(family: _Family) -> None:
    """Refuses names that look like those of several recordings, with frame numbers that run on through all."""
    parts = [part for part in family.parts() if len(part) > 1]
    frames = family.frames()
    if not _distinct(frames) or len(parts) < 2 or sum(map(len, parts)) < len(frames):
        return
    part_of = {name.path: index for index, part in enumerate(parts) for name in part}
    order = [part_of[frame.path] for frame in frames]
    changes = [index for index in range(1, len(order)) if order[index] != order[index - 1]]
    if len(changes) == len(parts) - 1:
        _refuse_unclear(frames[changes[0] - 1], frames[changes[0]])


def _refuse_one_run(recordings: list[list[Frame]]) -> None:
    """Refuses names with different words whose numbers run through all of them."""
    frames = sorted((frame for recording in recordings for frame in recording), key=_number)
    if len(recordings) > 1 and _distinct(frames) and _runs(frames):
        first = {frame.path for frame in recordings[0]}
        change = next(i for i, frame in enumerate(frames) if (frame.path in first) != (frames[0].path in first))
        _refuse_unclear(frames[change - 1], frames[change])


def _refuse_unclear(before: Frame, after: Frame) -> None:
    raise ImportFailure(
        f"{before.path} and {after.path}: the names differ, but the numbers run on; allowed: one kind of name for each "
        "recording in a folder, and numbers that restart"
    )


def _refuse_lone_frames(recordings: list[list[Frame]]) -> None:
    """Refuses a recording of one frame among others in its folder, such as the copy of a file."""
    for recording in recordings:
        if len(recording) == 1 and len(recordings) > 1:
            raise ImportFailure(
                f"{recording[0].path}: no other file has a name of this kind; allowed: 2 frames or more for each "
                "recording in a folder"
            )


def _number(frame: Frame) -> Fraction:
    return frame.number


def _distinct(frames: Sequence[Frame]) -> bool:
    return len({frame.number for frame in frames}) == len(frames)


def _steps(numbers: Sequence[Fraction]) -> list[Fraction]:
    ordered = sorted(numbers)
    return [after - before for before, after in zip(ordered[:-1], ordered[1:], strict=True)]


def _runs(frames: Sequence[Frame]) -> bool:
    """Whether numbers run as those of frames do."""
    steps = _steps([frame.number for frame in frames])
    return sum(steps) <= _LARGEST_STEP * len(steps)


def _steady(frames: Sequence[Frame]) -> bool:
    """Whether numbers are evenly spaced, as times are; two numbers say nothing."""
    steps = _steps([frame.number for frame in frames])
    return len(steps) > 1 and max(steps) <= _LARGEST_RATIO * min(steps)


def _common_step(steps: Sequence[Fraction]) -> Fraction:
    """The largest step that all steps are multiples of; 1 without steps."""
    scale = math.lcm(*(step.denominator for step in steps))
    return Fraction(math.gcd(*(int(step * scale) for step in steps)) or scale, scale)


def _shown(number: Fraction) -> str:
    return str(number.numerator) if number.denominator == 1 else f"{float(number):.9g}"
