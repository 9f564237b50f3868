"""The page of `graphrl report`: a run's numbers, what it missed, its curves, figures, video and settings."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import imageio.v2 as imageio
import numpy as np

from graphrl_jax.viz import formats
from graphrl_jax.viz.page import (
    HALF_WIDTH,
    LEVELS,
    Line,
    Plot,
    embedded,
    jpeg,
    number_ticks,
    power_ticks,
    progress_plot,
    shown_frames,
    write_page,
)

MOST_MEDIA_BYTES = 3_200_000
"""Bytes of figures and video in a page. As text they take a third more, and the page stays below 5 MB."""
MOST_CURVES = 48
"""Demonstrations that are drawn."""
_VIDEO_WIDTH = 480
_REWARDS = {
    "learned_reward": ("learned reward", "third"),
    "env_reward": ("environmental reward", "second"),
}
_LOSSES = {"loss": "first", "tcc": "third", "box": "second", "class": "fourth"}


Ticks = Callable[[float, float], list[tuple[float, str]]]
Figure = tuple[Path, str]
"""A .png file and its caption."""


@dataclass(frozen=True)
class Number:
    """A number with its label and what it means."""

    value: str
    label: str
    meaning: str


@dataclass(frozen=True)
class Kind:
    """Demonstrations of a kind under the learned reward.

    Attributes:
      name: of the kind, such as `success` or the failure `one_target`.
      end: mean progress at the end, 0 to 1.
      total: mean sum of the reward over an episode.
      below: share of the pairs with a success in which the success has the larger sum; None for successes.
    """

    name: str
    end: float | None
    total: float | None
    below: float | None


@dataclass(frozen=True)
class HeldOut:
    """Progress in demonstrations that an encoder was not trained on.

    Attributes:
      progress: (T,) progress of each, 0 to 1.
      success: (B,) bool, which of them solve the task.
      like_success: (B,) bool, which of them end like a success.
      kinds: kind of each.
      frame_rate: frames per second.
      level: progress from which an end looks like success.
    """

    progress: Sequence[np.ndarray]
    success: np.ndarray
    like_success: np.ndarray
    kinds: Sequence[str]
    frame_rate: float
    level: float


@dataclass(frozen=True)
class Subtasks:
    """Subtasks that were found in demonstrations.

    Attributes:
      of: the demonstrations, in words.
      method: rule that found them.
      rows: per demonstration its kind, its seconds, and the seconds at which all subtasks but the first begin.
    """

    of: str
    method: str
    rows: Sequence[tuple[str, float, Sequence[float]]]


@dataclass(frozen=True)
class RunContent:
    """What the page of a run tells.

    Attributes:
      title: of the page.
      about: a sentence or two below it.
      numbers: the headline numbers.
      missed: sentences, one for each thing that the run lacks.
      ppo, pretrain: lines of metrics.jsonl.
      success_rate: of the final evaluation; None without one.
      audit: the audit's numbers.
      audit_note: what there is to say about its scenes.
      kinds: kinds of demonstrations, under the learned reward.
      held_out: progress in held-out demonstrations, if it is known.
      subtasks: found in demonstrations, if they are known.
      subtask_numbers: how they were judged.
      landscape, rollouts, demonstrations: figures of the reward on scenes, on episodes of the policy and on held-out
        demonstrations; None without one.
      video: of the policy, if there is one.
      command: repeats the run.
      command_note: what there is to say about it.
      settings: values by name, by group.
      made_with: versions, device and the like, by name.
    """

    title: str
    about: str
    numbers: Sequence[Number]
    missed: Sequence[str]
    ppo: Sequence[Mapping[str, Any]]
    pretrain: Sequence[Mapping[str, Any]]
    success_rate: float | None
    audit: Sequence[Number]
    audit_note: str
    kinds: Sequence[Kind]
    held_out: HeldOut | None
    subtasks: Subtasks | None
    subtask_numbers: Sequence[Number]
    landscape: Figure | None
    rollouts: Figure | None
    demonstrations: Figure | None
    video: Path | None
    command: str
    command_note: str
    settings: Mapping[str, Mapping[str, str]]
    made_with: Mapping[str, str]


def run_page(path: Path, content: RunContent) -> None:
    """Writes the page of a run.

    Args:
      path: the HTML file.
      content: what it tells.
    """
    figures, room = _figures([content.landscape, content.rollouts, content.demonstrations], MOST_MEDIA_BYTES)
    held_out = content.held_out
    write_page(
        path,
        "report.html",
        title=content.title,
        content=content,
        outcome=_outcome(content.ppo, content.success_rate),
        rewards=_rewards(content.ppo),
        losses=_losses(content.pretrain),
        figures=figures,
        video=None if content.video is None else _video(content.video, room),
        curves=[] if held_out is None else [_curves(held_out, success) for success in (True, False)],
        strips=[] if content.subtasks is None else _strips(content.subtasks),
        strips_drawn="" if content.subtasks is None else _drawn(len(content.subtasks.rows)),
    )


def _outcome(records: Sequence[Mapping[str, Any]], evaluated: float | None) -> Plot | None:
    """Success and score of training episodes over environment steps."""
    names = {"success": "first", "score": "second"}
    lines = [Line(*_series(records, "env_steps", name), style, name) for name, style in names.items()]
    if not any(len(line.x) for line in lines):
        return None
    last = _last(records, "env_steps")
    dots = [] if evaluated is None else [(last, evaluated, "first", f"final evaluation: {formats.percent(evaluated)}")]
    ticks = number_ticks(0.0, last)
    label = "success and score of training episodes over environment steps"
    return Plot(label, last, 0.0, 1.0, lines, ticks, LEVELS, dots=dots, width=HALF_WIDTH)


def _rewards(records: Sequence[Mapping[str, Any]]) -> list[tuple[str, Plot]]:
    """Each reward per step over environment steps, on a scale of its own."""
    plots, last = [], _last(records, "env_steps")
    for name, (label, style) in _REWARDS.items():
        line = Line(*_series(records, "env_steps", name), style)
        if len(line.x):
            plots.append((label, _scaled(f"{label} over environment steps", last, [line])))
    return plots


def _losses(records: Sequence[Mapping[str, Any]]) -> Plot | None:
    """The losses of pretraining over its steps, on a logarithmic axis."""
    series = [(*_series(records, "step", name), style, name) for name, style in _LOSSES.items()]
    lines = [Line(x[y > 0], np.log10(y[y > 0]), style, name) for x, y, style, name in series if (y > 0).any()]
    if not lines:
        return None
    return _scaled("losses of pretraining over its steps", _last(records, "step"), lines, power_ticks)


def _scaled(label: str, last: float, lines: Sequence[Line], ticks: Ticks = number_ticks) -> Plot:
    """A plot whose heights are those of its lines."""
    heights = np.concatenate([line.y for line in lines])
    low, high = float(heights.min()), float(heights.max())
    margin = 0.05 * (high - low) or max(0.05 * abs(high), 0.05)
    low, high = low - margin, high + margin
    return Plot(label, last, low, high, lines, number_ticks(0.0, last), ticks(low, high), width=HALF_WIDTH)


def _series(records: Sequence[Mapping[str, Any]], over: str, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Places and finite values (M,) of the records that have both."""
    pairs = [(record[over], record[name]) for record in records if over in record and name in record]
    x, y = np.array(pairs, np.float64).reshape(-1, 2).T
    return x[np.isfinite(y)], y[np.isfinite(y)]


def _last(records: Sequence[Mapping[str, Any]], name: str) -> float:
    return max([float(record[name]) for record in records if name in record] + [1.0])


def _curves(held_out: HeldOut, success: bool) -> tuple[str, Plot] | None:
    """How many held-out successes or failures there are, in words, and their plot."""
    chosen = np.flatnonzero(held_out.success == success)
    if not len(chosen):
        return None
    lines = []
    for number in chosen[:MOST_CURVES]:
        curve, like_success = held_out.progress[number], bool(held_out.like_success[number])
        times = np.arange(len(curve)) / held_out.frame_rate
        style = "first thin" if like_success == success else "wrong thin"
        title = f"{held_out.kinds[number]}: ends at {curve[-1]:.2f}, {'like' if like_success else 'unlike'} a success"
        lines.append(Line(times, curve, style, title))
    seconds = max(float(line.x[-1]) for line in lines) or 1.0
    name = "successes" if success else "failures"
    label = f"progress in held-out {name} over seconds"
    plot = progress_plot(label, seconds, lines, HALF_WIDTH, levels=[held_out.level])
    return f"{len(chosen)} {name}{_drawn(len(chosen))}", plot


def _drawn(number: int) -> str:
    """What to say if not all of some demonstrations are drawn."""
    return f", of which the first {MOST_CURVES} are drawn" if number > MOST_CURVES else ""


def _strips(subtasks: Subtasks) -> list[tuple[str, list[tuple[float, str]]]]:
    """Per demonstration its title, and the width in percent and the seconds of each of its subtasks."""
    longest = max(seconds for _, seconds, _ in subtasks.rows)
    rows = []
    for kind, seconds, begins in subtasks.rows[:MOST_CURVES]:
        ends = [0.0, *begins, seconds]
        parts = [
            (round(100 * (end - begin) / longest, 2), f"subtask {number}: {begin:.1f} to {end:.1f} s")
            for number, (begin, end) in enumerate(zip(ends[:-1], ends[1:], strict=True), 1)
        ]
        rows.append((kind, parts))
    return rows


def _figures(figures: Sequence[Figure | None], room: int) -> tuple[list[tuple[str | None, str] | None], int]:
    """Addresses and captions of the figures, and the bytes that are left; no address of those without room."""
    shown = []
    for figure in figures:
        if figure is None:
            shown.append(None)
            continue
        path, caption = figure
        size = path.stat().st_size
        if size <= room:
            shown.append((embedded(path), caption))
            room -= size
        else:
            shown.append((None, f"{caption} It is too large for this page: {path.name}."))
    return shown, room


def _video(path: Path, room: int) -> dict[str, Any]:
    """The video, or some frames of it if it is too large for the page."""
    size = path.stat().st_size
    if size <= room:
        return {"name": path.name, "address": embedded(path), "frames": []}
    with imageio.get_reader(path) as reader:
        rate, numbers = reader.get_meta_data()["fps"], shown_frames(reader.count_frames())
        frames = [(number / rate, jpeg(reader.get_data(number), _VIDEO_WIDTH)) for number in numbers.tolist()]
    return {"name": path.name, "address": None, "frames": frames, "megabytes": f"{size / 1e6:.1f}"}
