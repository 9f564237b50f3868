"""Figures of the learned reward on Shoes in Box: its profile under frames of the scene, and subtasks found in it."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.offsetbox import AnnotationBbox, OffsetImage

from benchmarks.figures import plain, save
from graphrl_jax.demonstrations import Demonstrations, reached_for_good
from graphrl_jax.reward.config import SUBTASK_METHODS
from graphrl_jax.reward.model import RewardModel, demonstration_rewards
from graphrl_jax.reward.subtasks import demonstration_subtasks, true_boundaries
from tasks.shoes_in_box import expert, render
from tasks.shoes_in_box.task import ShoesInBox

IMAGES, OTHERS = 7, 8


def profile_figure(
    task: ShoesInBox,
    model: RewardModel,
    demos: Demonstrations,
    states: Any,
    busy: np.ndarray,
    solved: np.ndarray,
    path: Path,
) -> None:
    """The reward over time of a success (the first of `states` that is one), with images above it and events marked.

    Behind it, in grey, those of other successes.
    """
    shown = int(np.argmax(solved))
    length = min(int(busy[shown]) + expert.TAIL_FRAMES[0], demos.num_frames)
    boxes, mask, events = (np.asarray(leaf)[shown] for leaf in expert.seen(task, states))
    single = replace(
        demos.select([0]),
        boxes=boxes[None],
        mask=mask[None],
        lengths=np.array([length], np.int32),
        success=np.array([True]),
        events=None,
        event_names=(),
    )
    seconds = np.arange(length) / demos.frame_rate
    figure = Figure(figsize=(12, 5.6), dpi=110, layout="constrained")
    images, axes = figure.subplots(2, 1, height_ratios=(1, 2.2))
    others = demos.successes().select(np.arange(min(OTHERS, int(demos.success.sum()))))
    for reward, until in zip(np.asarray(demonstration_rewards(model, others)), others.lengths, strict=True):
        axes.plot(np.arange(until) / demos.frame_rate, reward[:until], color="0.8", linewidth=0.8)
    axes.plot(seconds, np.asarray(demonstration_rewards(model, single))[0, :length], color="tab:green", linewidth=1.8)
    for name, frame in zip(task.event_names, reached_for_good(events[None])[0], strict=True):
        _mark(axes, frame / demos.frame_rate, name.replace("_", " "))
    axes.set(xlabel="time (s)", ylabel="learned reward", xlim=(0, seconds[-1]))
    plain(axes)
    images.set(xlim=(0, seconds[-1]), ylim=(0, 1))
    images.axis("off")
    # Each image stands above its own moment.
    for frame in ((np.arange(IMAGES) + 0.5) / IMAGES * length).astype(int):
        image = OffsetImage(render.draw_scene(states.qpos[shown, frame], states.box[shown, frame], 150), zoom=0.72)
        images.add_artist(AnnotationBbox(image, (seconds[frame], 0.5), frameon=False))
    save(figure, path)


def _mark(axes: Axes, second: float, name: str) -> None:
    axes.axvline(second, color="tab:orange", linewidth=1, linestyle="--")
    at = {"transform": axes.get_xaxis_transform(), "rotation": 90, "fontsize": 8, "va": "bottom", "ha": "right"}
    axes.text(second, 0.02, f"{name} ", **at)


def subtasks_figure(model: RewardModel, demos: Demonstrations, path: Path) -> None:
    """Profiles of three successes and of a failure of three kinds, boundaries found (lines) and true (triangles)."""
    assert demos.kinds is not None and demos.events is not None
    failed = [int(np.flatnonzero(demos.kinds == kind)[0]) for kind in ("lid_falls_shut", "shoe_dropped", "one_shoe")]
    some = demos.select(np.concatenate([np.flatnonzero(demos.success)[:3], failed]))
    assert some.kinds is not None and some.events is not None
    rewards = np.asarray(demonstration_rewards(model, some))
    found = demonstration_subtasks(model, some, SUBTASK_METHODS[0])["subtasks"]
    figure = Figure(figsize=(12, 5), dpi=110, layout="constrained")
    for index, axes in enumerate(figure.subplots(2, 3, sharey=True).ravel()):
        length = int(some.lengths[index])
        axes.plot(np.arange(length) / some.frame_rate, rewards[index, :length], color="tab:green")
        for frame in found[index]["boundaries"]:
            axes.axvline(frame / some.frame_rate, color="tab:blue", linewidth=1)
        true = np.array(true_boundaries(some.events[index], length))
        axes.plot(true / some.frame_rate, np.full(len(true), 0.03), "^", color="tab:orange",
                  transform=axes.get_xaxis_transform())  # fmt: skip
        axes.set(xlabel="time (s)", title=str(some.kinds[index]).replace("_", " "))
        plain(axes)
    figure.suptitle("Learned reward, boundaries found (blue) and true events (orange)")
    save(figure, path)
