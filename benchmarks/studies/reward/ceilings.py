"""What the audit's measures give for ideal values, computed from true boxes: no encoder can be expected to do better.

    python -m benchmarks.studies.reward.ceilings

Ideal is minus the way to go: the targets' summed distance to the region, plus `approach` times the robot's distance to
the target that it brings next. Writes ceilings.json beside this file.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tyro

from benchmarks.context import measured_on
from benchmarks.exploits import unseen_trajectories
from graphrl_jax.demonstrations import Demonstrations
from graphrl_jax.experiment.keys import RunStage, stage_key
from graphrl_jax.pretrain.augment import INSET
from graphrl_jax.registry import make_task
from graphrl_jax.reward.alignment import kendall_tau, value_order_correlation
from graphrl_jax.reward.landscape import Landscape, scores
from graphrl_jax.reward.statistics import pair_accuracy, share_above
from graphrl_jax.runtime import configure
from graphrl_jax.storage import write_json

REGION, ROBOT, TARGETS = 0, 1, slice(2, 4)
APPROACHES = (0.0, 0.05, 0.15, 0.5, 1.0)
SEEDS = (0, 1, 2)
SET_OFF = 0.01


@dataclass(frozen=True)
class Options:
    """Computes what ideal values score."""


def distances(boxes: np.ndarray) -> dict[str, np.ndarray]:
    """Targets' summed distances in scenes (M, N, 4) to the region's centre, to its nearest point, and to where they may
    end in a rearrangement, averaged over such ends."""
    centre, half = boxes[0, REGION, :2], boxes[0, REGION, 2:] / 2
    offsets = boxes[:, TARGETS, :2] - centre
    places = np.random.default_rng(0).uniform(2 * INSET - 1, 1 - 2 * INSET, (200, 2)) * half
    length = np.linalg.norm
    return {
        "centre": length(offsets, axis=-1).sum(1),
        "nearest": length(np.maximum(np.abs(offsets) - half, 0), axis=-1).sum(1),
        "ends": length(offsets[:, :, None] - places, axis=-1).mean(-1).sum(1),
    }


def nearest_target(boxes: np.ndarray) -> np.ndarray:
    """The robot's distance to the nearest target in scenes (M, N, 4): (M,)."""
    return np.linalg.norm(boxes[:, TARGETS, :2] - boxes[:, ROBOT, None, :2], axis=-1).min(1)


def landscape_ceilings(landscape: Landscape) -> dict[str, Any]:
    """Pair accuracy and finished above unfinished of every ideal distance; pair accuracy with approaches added."""
    scenes, done, undone = (
        distances(found.boxes) for found in (landscape.random, landscape.finished, landscape.unfinished)
    )
    robot = nearest_target(landscape.random.boxes)
    truth = -landscape.random_distance
    return {
        "pair_accuracy": {name: pair_accuracy(-way, truth) for name, way in scenes.items()},
        "finished_above_unfinished": {name: share_above(-done[name], -undone[name]) for name in done},
        "pair_accuracy_by_approach": {
            str(approach): pair_accuracy(-scenes["ends"] - approach * robot, truth) for approach in APPROACHES
        },
    }


def trajectory_ceilings(trajectories: Demonstrations) -> dict[str, float]:
    """Share of (success, failure) pairs with the success above, for the ideal value without the robot's way."""
    flat = trajectories.boxes.reshape(-1, *trajectories.boxes.shape[2:])
    values = -distances(flat)["ends"].reshape(trajectories.boxes.shape[:2])
    return scores(values, trajectories)["successes_above"]


def way_to_go(boxes: np.ndarray, approach: float) -> np.ndarray:
    """Of one demonstration (T, N, 4): the targets' ways to their ends plus the robot's to the next target, (T,)."""
    targets, robot = boxes[:, TARGETS, :2], boxes[:, ROBOT, :2]
    left = np.linalg.norm(targets - targets[-1], axis=-1)
    moved = np.linalg.norm(targets - targets[0], axis=-1) > SET_OFF
    first, second = np.argsort(np.argmax(moved, axis=0))
    # The second is next from the moment on that the first lies where it stays.
    change = np.argmax(left[:, first] < SET_OFF)
    before = np.arange(len(boxes)) < change
    following = targets[np.arange(len(boxes)), np.where(before, first, second)]
    between = np.linalg.norm(targets[change, first] - targets[change, second])
    return left.sum(1) + approach * (np.linalg.norm(robot - following, axis=-1) + before * between)


def time_ceilings(demos: Demonstrations) -> dict[str, dict[str, float]]:
    """Rank correlation with time of the ideal value, and Kendall's tau of it as a one-dimensional embedding."""
    correlations, taus = {}, {}
    for approach in APPROACHES:
        values = np.zeros(demos.mask.shape[:2], np.float32)
        for index, length in enumerate(demos.lengths):
            values[index, :length] = -way_to_go(demos.boxes[index, :length], approach)
        correlations[str(approach)] = float(np.mean(value_order_correlation(values, demos.lengths)))
        taus[str(approach)] = kendall_tau(values[..., None], demos.lengths)
    return {"rank_correlation_by_approach": correlations, "kendall_tau_by_approach": taus}


def main() -> None:
    """Computes and writes."""
    tyro.cli(Options, description=__doc__)
    configure()
    task = make_task("match_regions")
    results: dict[str, Any] = {}
    for seed in SEEDS:
        demos = task.demonstrate(stage_key(seed, RunStage.DEMONSTRATIONS), 64)
        results[str(seed)] = {
            **landscape_ceilings(task.landscape(stage_key(seed, RunStage.LANDSCAPE))),
            **time_ceilings(demos.split(0.75, seed)[1]),
            "successes_above": trajectory_ceilings(unseen_trajectories(task, seed)),
        }
        print(seed, results[str(seed)])
    write_json(Path(__file__).parent / "ceilings.json", {"seeds": results, **measured_on("studies.reward.ceilings")})


if __name__ == "__main__":
    main()
