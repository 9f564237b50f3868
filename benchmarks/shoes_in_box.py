"""The learned reward on Shoes in Box: profile, discrimination of successes from failures, stages.

    python -m benchmarks.shoes_in_box runs/shoes_in_box_graph_0 [more runs, of either pooling and any seed]

Runs are those of `train.py --task shoes_in_box` or of `python -m graphrl_jax pretrain`. All are judged by the same
demonstrations of a seed of their own, which no encoder saw. Writes benchmarks/results/shoes_in_box.json and pictures.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import jax
import numpy as np
import tyro
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.offsetbox import AnnotationBbox, OffsetImage

from benchmarks.context import measured_on
from graphrl_jax import demonstrations as demonstration_files
from graphrl_jax import pipeline, stages
from graphrl_jax.compilation import configure
from graphrl_jax.demonstrations import Demonstrations
from graphrl_jax.discrimination import discrimination
from graphrl_jax.encoder import EncoderConfig
from graphrl_jax.reward import RewardModel, demonstration_rewards
from graphrl_jax.runs import Run, write_atomically, write_json
from graphrl_jax.task import make_task
from tasks.shoes_in_box import expert, render
from tasks.shoes_in_box.env import ShoesInBox

RESULTS = Path("benchmarks/results")
SUCCESSES, FAILURES = 32, 36
PICTURES = 7


@dataclass(frozen=True)
class Options:
    """Judges the rewards of finished runs on demonstrations that no encoder saw.

    Attributes:
      runs: folders of runs.
      seed: of the demonstrations that judge.
      demos: where these are kept; made if missing.
    """

    runs: tyro.conf.Positional[tuple[Path, ...]]
    seed: int = 1007
    demos: Path = Path("runs/shoes_in_box_validation.npz")


def pooling(model: RewardModel) -> str:
    """Name of the reward by what it pools."""
    return "graph" if float(model.suppress_robot) else "graph_with_robot"


def judge(model: RewardModel, demos: Demonstrations) -> dict[str, Any]:
    """Discrimination over all demonstrations; stages of successes and of every kind of failure, by both methods."""
    rewards = np.asarray(demonstration_rewards(model, demos))
    assert demos.kinds is not None
    kinds = {str(kind): demos.select(demos.kinds == kind) for kind in np.unique(demos.kinds)}
    judged = {
        method: {kind: pipeline.demonstration_stages(model, those, method)["judged"] for kind, those in kinds.items()}
        for method in pipeline.STAGE_METHODS
    }
    return {"discrimination": discrimination(rewards, demos.lengths, demos.success), "stages": judged}


def profile_figure(task: ShoesInBox, model: RewardModel, demos: Demonstrations, seed: int, path: Path) -> None:
    """The reward over time of a new success, pictures above it and events marked, and of successes that judge."""
    key = pipeline.stage_key(seed, pipeline.RECORDING)
    states, busy = jax.tree.map(np.asarray, expert.rollouts(task, key, np.zeros(8, np.int32)))
    solved = np.asarray(jax.vmap(expert.environment.success)(jax.tree.map(lambda leaf: leaf[:, -1], states)))
    shown = int(np.argmax(solved))
    length = min(int(busy[shown]) + expert.TAIL_FRAMES, demos.num_frames)
    boxes, events = (np.asarray(leaf)[shown] for leaf in expert.seen(states))
    single = replace(
        demos.select([0]),
        boxes=boxes[None],
        mask=np.ones((1, *boxes.shape[:2]), bool),
        lengths=np.array([length], np.int32),
        success=np.array([True]),
        events=None,
        event_names=(),
    )
    rewards = np.asarray(demonstration_rewards(model, single))[0, :length]
    figure = Figure(figsize=(12, 5.6), dpi=110, layout="constrained")
    pictures, axes = figure.subplots(2, 1, height_ratios=(1, 2.2))
    seconds = np.arange(length) / single.frame_rate
    others = demos.successes()
    for other, until in list(zip(np.asarray(demonstration_rewards(model, others)), others.lengths, strict=True))[:8]:
        axes.plot(np.arange(until) / single.frame_rate, other[:until], color="0.8", linewidth=0.8)
    axes.plot(seconds, rewards, color="tab:green", linewidth=1.8)
    for name, frame in zip(task.event_names, demonstration_files.reached_for_good(events[None])[0], strict=True):
        axes.axvline(frame / single.frame_rate, color="tab:orange", linewidth=1, linestyle="--")
        axes.text(frame / single.frame_rate, 0.02, f" {name.replace('_', ' ')}", rotation=90, fontsize=8, va="bottom",
                  transform=axes.get_xaxis_transform())  # fmt: skip
    axes.set(xlabel="time (s)", ylabel="learned reward", xlim=(0, seconds[-1]))
    axes.spines[["top", "right"]].set_visible(False)
    pictures.set(xlim=(0, seconds[-1]), ylim=(0, 1))
    pictures.axis("off")
    for frame in np.linspace(0, length - 1, PICTURES).astype(int):
        image = OffsetImage(render.draw_scene(states.qpos[shown, frame], states.box[shown, frame], 150), zoom=0.85)
        at = (np.clip(seconds[frame], 0.06 * seconds[-1], 0.94 * seconds[-1]), 0.5)
        pictures.add_artist(AnnotationBbox(image, at, frameon=False))
    write_atomically(path, FigureCanvasAgg(figure).print_png)


def stages_figure(model: RewardModel, demos: Demonstrations, path: Path, shown: int = 6) -> None:
    """Profiles of successes with boundaries found (lines) and true (triangles)."""
    some = demos.successes().select(np.arange(shown))
    rewards = np.asarray(demonstration_rewards(model, some))
    found = pipeline.demonstration_stages(model, some, "change_points")["stages"]
    figure = Figure(figsize=(12, 5), dpi=110, layout="constrained")
    assert some.events is not None
    for index, axes in enumerate(figure.subplots(2, shown // 2, sharey=True).ravel()):
        length = some.lengths[index]
        axes.plot(np.arange(length) / some.frame_rate, rewards[index, :length], color="tab:green")
        for frame in found[index]["boundaries"]:
            axes.axvline(frame / some.frame_rate, color="tab:blue", linewidth=1)
        true = np.array(stages.true_boundaries(some.events[index], length))
        axes.plot(true / some.frame_rate, np.full(len(true), 0.03), "^", color="tab:orange",
                  transform=axes.get_xaxis_transform())  # fmt: skip
        axes.set(xlabel="time (s)")
        axes.spines[["top", "right"]].set_visible(False)
    figure.suptitle("Learned reward, boundaries found (blue) and true events (orange)")
    write_atomically(path, FigureCanvasAgg(figure).print_png)


def main() -> None:
    """Judges, draws, prints and writes."""
    options = tyro.cli(Options, description=__doc__)
    configure()
    where = measured_on("shoes_in_box")
    task = make_task("shoes_in_box")
    assert isinstance(task, ShoesInBox)
    if not options.demos.exists():
        key = pipeline.stage_key(options.seed, pipeline.DEMONSTRATIONS)
        task.demonstrate(key, SUCCESSES, FAILURES).save(options.demos)
    demos = demonstration_files.load(options.demos)
    rows = []
    for number, path in enumerate(options.runs):
        model = pipeline.load_reward(Run(path), EncoderConfig(), task)
        rows.append({"run": path.name, "reward": pooling(model), **judge(model, demos)})
        print(rows[-1]["run"], rows[-1]["reward"], rows[-1]["discrimination"])
        if number == 0:
            profile_figure(task, model, demos, options.seed, RESULTS / "shoes_in_box_profile.png")
            stages_figure(model, demos, RESULTS / "shoes_in_box_stages.png")
    write_json(RESULTS / "shoes_in_box.json", {"runs": rows, "demonstrations_seed": options.seed, **where})


if __name__ == "__main__":
    main()
