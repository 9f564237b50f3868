"""Audit of a learned reward away from the demonstrations, before a policy is trained on it.

Rank correlation with time on demonstrations says nothing about the states that a policy visits: encoders at 0.99 were
exploited by policies that never solved the task. The audit tests what matters to a policy. Does the reward order random
scenes as the task does? Is every finished scene above every unfinished one? Are the maxima inside the goal? Does the
reward fall across the goal's edge? Does it pay for bumping bystanders? Are successful trajectories above failures and
known exploits? True distances and regions are used in this evaluation only; no reward uses them.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import jax
import numpy as np

from graphrl_jax.demonstrations import Demonstrations
from graphrl_jax.graph import ObjectTable, build_graph
from graphrl_jax.reward.discrimination import DISCOUNT
from graphrl_jax.reward.model import RewardModel, demonstration_rewards
from graphrl_jax.reward.statistics import pair_accuracy, share_above

DrawImage = Callable[[Any], jax.Array]
"""Draws the image (H, W, 3) of a physics state."""


@dataclass(frozen=True)
class Scenes:
    """Scenes of shape (...).

    | field  | shape       | meaning                                                                        |
    |--------|-------------|--------------------------------------------------------------------------------|
    | boxes  | (..., N, 4) | float32, centre and size of each slot's box as in `Graph`                      |
    | active | (..., N)    | bool, slots that count as moved; fewer axes if all scenes agree                |
    | states | (..., ...)  | leaves of physics states, for rewards from images; None if the task draws none |
    """

    boxes: np.ndarray
    active: np.ndarray
    states: Any = None


@dataclass(frozen=True)
class Grid:
    """Scenes in which one object is moved over the arena and all others are fixed.

    | field        | shape        | meaning                                              |
    |--------------|--------------|------------------------------------------------------|
    | name         |              | the moved object, and the place of the other one     |
    | scenes       | (Y, X)       | `Scenes`                                             |
    | x, y         | (X,), (Y,)   | positions of the object's centre, in task units      |
    | inside       | (Y, X)       | bool, whether the position is inside the goal        |
    | goal_outline | (V, 2)       | corners of the goal                                  |
    | start        | (2,)         | start of the object                                  |
    """

    name: str
    scenes: Scenes
    x: np.ndarray
    y: np.ndarray
    inside: np.ndarray
    goal_outline: np.ndarray
    start: np.ndarray


@dataclass(frozen=True)
class Landscape:
    """The scenes of an audit, supplied by a task.

    | field           | shape        | meaning                                                           |
    |-----------------|--------------|-------------------------------------------------------------------|
    | objects         |              | the node slots                                                    |
    | mask            | (N,)         | bool, filled slots, the same in every scene                       |
    | grids           |              | tuple of `Grid`                                                   |
    | random          | (M,)         | random `Scenes`, never demonstrated                               |
    | random_distance | (M,)         | true summed distance of the targets to the goal, 0 once inside    |
    | finished        | (K,)         | `Scenes` in which the task is solved                              |
    | unfinished      | (K,)         | the same scenes with at least one target outside                  |
    | within          | (J,)         | `Scenes` with a target some way inside the goal                   |
    | beside          | (J,)         | the same scenes with that target just outside                     |
    """

    objects: ObjectTable
    mask: np.ndarray
    grids: tuple[Grid, ...]
    random: Scenes
    random_distance: np.ndarray
    finished: Scenes
    unfinished: Scenes
    within: Scenes
    beside: Scenes


@dataclass(frozen=True)
class GridReport:
    """Rewards (Y, X) of a grid, the data for its plot, and the position of the maximum."""

    name: str
    values: np.ndarray
    x: np.ndarray
    y: np.ndarray
    goal_outline: np.ndarray
    start: np.ndarray
    maximum: np.ndarray
    maximum_inside: bool


@dataclass(frozen=True)
class LandscapeReport:
    """Result of an audit.

    Attributes:
      grids: one report per grid.
      pair_accuracy: share of pairs of random scenes that the reward orders as the true distance does.
      finished_above_unfinished: share of (finished, unfinished) pairs in which the finished scene has more reward.
      maxima_inside: share of grids with the largest reward inside the goal; None without grids.
      within_above_beside: share of scenes with more reward for a target inside the goal than just outside it, all else
        equal; where this fails, a policy leaves targets on the edge.
      bump_bonus: mean reward that a random scene gains if all its movable objects count as moved. It is what a policy
        is paid for bumping bystanders; best near 0.
    """

    grids: tuple[GridReport, ...]
    pair_accuracy: float
    finished_above_unfinished: float
    maxima_inside: float | None
    within_above_beside: float
    bump_bonus: float

    def metrics(self) -> dict[str, float]:
        """The four shares and the bonus by name; without grids, three shares."""
        inside = {} if self.maxima_inside is None else {"maxima_inside": self.maxima_inside}
        return {
            "within_above_beside": self.within_above_beside,
            "bump_bonus": self.bump_bonus,
            "pair_accuracy": self.pair_accuracy,
            "finished_above_unfinished": self.finished_above_unfinished,
            **inside,
        }


def audit(model: RewardModel, landscape: Landscape, draw_image: DrawImage | None = None) -> LandscapeReport:
    """Evaluates the reward on all scenes of a landscape.

    Args:
      model: the reward.
      landscape: the scenes.
      draw_image: draws a physics state, for a reward from images; other rewards receive graphs.
    """

    def rewards(scenes: Scenes) -> np.ndarray:
        shape = scenes.boxes.shape[:-2]
        if draw_image is not None:
            states = jax.tree.map(lambda leaf: leaf.reshape(-1, *leaf.shape[len(shape) :]), scenes.states)
            return np.asarray(_drawn_rewards(draw_image, model, states)).reshape(shape)
        flat = scenes.boxes.reshape(-1, *scenes.boxes.shape[-2:])
        flags = np.broadcast_to(scenes.active, (*shape, flat.shape[1])).reshape(flat.shape[:2])
        return np.asarray(_scene_rewards(landscape.objects, model, flat, landscape.mask, flags)).reshape(shape)

    grids = tuple(_grid_report(grid, rewards(grid.scenes)) for grid in landscape.grids)
    finished, unfinished = rewards(landscape.finished), rewards(landscape.unfinished)
    within, beside = rewards(landscape.within), rewards(landscape.beside)
    random = rewards(landscape.random)
    movable = ~np.array(landscape.objects.is_fixture) & ~np.array(landscape.objects.is_robot)
    bumped = rewards(replace(landscape.random, active=landscape.random.active | movable))
    return LandscapeReport(
        grids=grids,
        pair_accuracy=pair_accuracy(random, -landscape.random_distance),
        finished_above_unfinished=share_above(finished, unfinished),
        maxima_inside=float(np.mean([grid.maximum_inside for grid in grids])) if grids else None,
        within_above_beside=float(np.mean(within > beside)),
        bump_bonus=float(np.mean(bumped - random)),
    )


def trajectory_scores(
    model: RewardModel, demonstrations: Demonstrations, discount: float = DISCOUNT, horizon: int | None = None
) -> dict[str, Any]:
    """Scores of fixed trajectories under the reward; see `scores`."""
    return scores(np.asarray(demonstration_rewards(model, demonstrations)), demonstrations, discount, horizon)


def scores(
    rewards: np.ndarray, demonstrations: Demonstrations, discount: float = DISCOUNT, horizon: int | None = None
) -> dict[str, Any]:
    """Scores of trajectories under `rewards` (B, T): successes, deliberate failures and known exploits.

    Each trajectory keeps the reward of its last frame until the `horizon`, such as the end of an episode (default: the
    end of the longest trajectory), so that length alone has no effect.

    Returns:
      `by_kind`: of each kind the mean undiscounted and discounted sums and the mean reward at the end (`end`);
      `successes_above`: share of (success, failure) pairs in which the success has more, for both sums, and for the
      undiscounted sum by kind of failure (absent without successes or without failures).
    """
    frames = np.minimum(np.arange(horizon or demonstrations.num_frames), demonstrations.lengths[:, None] - 1)
    rewards = np.take_along_axis(rewards, frames, axis=1)
    sums = {
        "undiscounted": rewards.sum(1),
        "discounted": (rewards * discount ** np.arange(rewards.shape[1])).sum(1),
    }
    kinds = demonstrations.kinds
    if kinds is None:
        kinds = np.where(demonstrations.success, "success", "failure")
    by_kind = {
        str(kind): {
            name: float(values[kinds == kind].mean()) for name, values in (*sums.items(), ("end", rewards[:, -1]))
        }
        for kind in np.unique(kinds)
    }
    report: dict[str, Any] = {"by_kind": by_kind, "discount": discount}
    success = demonstrations.success
    if success.any() and not success.all():
        report["successes_above"] = {
            name: share_above(values[success], values[~success]) for name, values in sums.items()
        }
        total = sums["undiscounted"]
        report["successes_above"]["by_kind"] = {
            str(kind): share_above(total[success], total[kinds == kind]) for kind in np.unique(kinds[~success])
        }
    return report


def _grid_report(grid: Grid, values: np.ndarray) -> GridReport:
    row, column = np.unravel_index(np.argmax(values), values.shape)
    maximum = np.array([grid.x[column], grid.y[row]])
    inside = bool(grid.inside[row, column])
    return GridReport(grid.name, values, grid.x, grid.y, grid.goal_outline, grid.start, maximum, inside)


@partial(jax.jit, static_argnames="draw_image")
def _drawn_rewards(draw_image: DrawImage, model: RewardModel, states: Any) -> jax.Array:
    return jax.lax.map(lambda state: model.apply(draw_image(state)), states, batch_size=64)


@partial(jax.jit, static_argnames="objects")
def _scene_rewards(
    objects: ObjectTable, model: RewardModel, boxes: jax.Array, mask: jax.Array, active: jax.Array
) -> jax.Array:
    graphs = jax.vmap(partial(build_graph, objects), in_axes=(0, None, 0))(boxes, mask, active)
    return jax.vmap(model.apply)(graphs)
