"""Auditing a learned reward away from the demonstrations, before any policy is trained on it.

Rank correlation with time on demonstrations says nothing of the places a policy will go: encoders at 0.99 were
exploited by policies that never solved the task. The audit asks what matters to a policy: does the reward order random
scenes as the task does, does every finished scene beat every unfinished one, do its maxima lie where they should, does
it fall across the goal's edge, does it pay for bumping bystanders, and do successful trajectories out-score failures
and known exploits? True distances and regions are used for judging only; no reward ever sees them.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import jax
import numpy as np

from graphrl_jax.demonstrations import Demonstrations
from graphrl_jax.graph import ObjectTable, build_graph
from graphrl_jax.reward import RewardModel, demonstration_rewards

Picture = Callable[[Any], jax.Array]
"""Draws a physics state: (H, W, 3)."""


@dataclass(frozen=True)
class Scenes:
    """Some scenes, shape (...).

    | field  | shape       | meaning                                                                    |
    |--------|-------------|----------------------------------------------------------------------------|
    | boxes  | (..., N, 4) | float32, corners of each slot's box as in `Graph`                          |
    | active | (..., N)    | bool, which slots count as moved; fewer axes if all scenes agree           |
    | states | (..., ...)  | leaves of physics states, for rewards of pictures; None where the task draws none |
    """

    boxes: np.ndarray
    active: np.ndarray
    states: Any = None


@dataclass(frozen=True)
class Grid:
    """One object moved over the arena, all else fixed.

    | field        | shape        | meaning                                              |
    |--------------|--------------|------------------------------------------------------|
    | name         |              | what is moved, and where the rest is                 |
    | scenes       | (Y, X)       | `Scenes`                                             |
    | x, y         | (X,), (Y,)   | places of the object's centre, the task's units      |
    | inside       | (Y, X)       | bool, whether that place is inside the goal          |
    | goal_outline | (V, 2)       | corners of the goal                                  |
    | start        | (2,)         | where the object starts                              |
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
    """The scenes of an audit: what a task hands over.

    | field           | shape        | meaning                                                           |
    |-----------------|--------------|-------------------------------------------------------------------|
    | objects         |              | the node slots                                                    |
    | mask            | (N,)         | bool, filled slots, the same in every scene                       |
    | grids           |              | tuple of `Grid`                                                   |
    | random          | (M,)         | `Scenes` never demonstrated                                       |
    | random_distance | (M,)         | true summed distance of the targets to the goal, 0 once inside    |
    | finished        | (K,)         | `Scenes` in which the task is done                                |
    | unfinished      | (K,)         | the same with at least one target outside                         |
    | within          | (J,)         | `Scenes` with a target some way inside the goal                   |
    | beside          | (J,)         | the same with it just outside                                     |
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
    """A grid's rewards (Y, X) beside what a picture of it needs, and where the largest lies."""

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
    """An audit's outcome.

    Attributes:
      grids: one report per grid.
      pair_accuracy: share of pairs of random scenes that the reward orders as the true distance does.
      finished_above_unfinished: share of (finished, unfinished) pairs in which the finished scene has more reward.
      maxima_inside: share of the grids whose largest reward lies inside the goal.
      within_above_beside: share of scenes in which a target inside the goal has more reward than just outside it, all
        else equal; a policy leaves targets on the edge where this fails.
      bump_bonus: how much reward a random scene gains if all that never moved in it counts as moved; what a policy is
        paid for bumping bystanders, best near 0.
    """

    grids: tuple[GridReport, ...]
    pair_accuracy: float
    finished_above_unfinished: float
    maxima_inside: float
    within_above_beside: float
    bump_bonus: float

    def numbers(self) -> dict[str, float]:
        """The four shares and the bonus by name."""
        return {
            "within_above_beside": self.within_above_beside,
            "bump_bonus": self.bump_bonus,
            "pair_accuracy": self.pair_accuracy,
            "finished_above_unfinished": self.finished_above_unfinished,
            "maxima_inside": self.maxima_inside,
        }


def audit(model: RewardModel, landscape: Landscape, picture: Picture | None = None) -> LandscapeReport:
    """Evaluates the reward on all scenes of a landscape.

    Args:
      model: the reward.
      landscape: the scenes.
      picture: draws a physics state, for a reward of pictures; others are shown graphs.
    """

    def rewards(scenes: Scenes) -> np.ndarray:
        shape = scenes.boxes.shape[:-2]
        if picture is not None:
            states = jax.tree.map(lambda leaf: leaf.reshape(-1, *leaf.shape[len(shape) :]), scenes.states)
            return np.asarray(_drawn_rewards(picture, model, states)).reshape(shape)
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
        maxima_inside=float(np.mean([grid.maximum_inside for grid in grids])),
        within_above_beside=float(np.mean(within > beside)),
        bump_bonus=float(np.mean(bumped - random)),
    )


def pair_accuracy(values: np.ndarray, truth: np.ndarray) -> float:
    """Share of pairs with different truth (M,) that `values` (M,) puts in the same order; ties count half."""
    value_order = np.sign(values[:, None] - values[None])
    true_order = np.sign(truth[:, None] - truth[None])
    decided = np.triu(true_order != 0, 1)
    return float(np.mean((1 + value_order[decided] * true_order[decided]) / 2))


def share_above(high: np.ndarray, low: np.ndarray) -> float:
    """Share of all pairs in which a member of `high` (P,) exceeds one of `low` (Q,), ties half: the AUROC."""
    difference = np.sign(np.ravel(high)[:, None] - np.ravel(low)[None])
    return float(np.mean((1 + difference) / 2))


def trajectory_scores(model: RewardModel, demonstrations: Demonstrations, discount: float = 0.99) -> dict[str, Any]:
    """How fixed trajectories score under the reward; see `scores`."""
    return scores(np.asarray(demonstration_rewards(model, demonstrations)), demonstrations, discount)


def scores(rewards: np.ndarray, demonstrations: Demonstrations, discount: float = 0.99) -> dict[str, Any]:
    """How trajectories score under `rewards` (B, T): successes, deliberate failures and known exploits.

    All are held to their last frame's reward until the longest one ends, so that length alone decides nothing.

    Returns:
      `by_kind`: mean undiscounted and discounted sums of each kind; `successes_above`: share of (success, failure)
      pairs with the success above, for both sums (absent without failures).
    """
    frames = np.minimum(np.arange(demonstrations.num_frames), demonstrations.lengths[:, None] - 1)
    rewards = np.take_along_axis(rewards, frames, axis=1)
    sums = {
        "undiscounted": rewards.sum(1),
        "discounted": (rewards * discount ** np.arange(rewards.shape[1])).sum(1),
    }
    kinds = demonstrations.kinds
    if kinds is None:
        kinds = np.where(demonstrations.success, "success", "failure")
    by_kind = {
        str(kind): {name: float(values[kinds == kind].mean()) for name, values in sums.items()}
        for kind in np.unique(kinds)
    }
    report: dict[str, Any] = {"by_kind": by_kind, "discount": discount}
    success = demonstrations.success
    if success.any() and not success.all():
        report["successes_above"] = {
            name: share_above(values[success], values[~success]) for name, values in sums.items()
        }
    return report


def _grid_report(grid: Grid, values: np.ndarray) -> GridReport:
    row, column = np.unravel_index(np.argmax(values), values.shape)
    maximum = np.array([grid.x[column], grid.y[row]])
    inside = bool(grid.inside[row, column])
    return GridReport(grid.name, values, grid.x, grid.y, grid.goal_outline, grid.start, maximum, inside)


@partial(jax.jit, static_argnames="picture")
def _drawn_rewards(picture: Picture, model: RewardModel, states: Any) -> jax.Array:
    return jax.lax.map(lambda state: model.apply(picture(state)), states, batch_size=64)


@partial(jax.jit, static_argnames="objects")
def _scene_rewards(
    objects: ObjectTable, model: RewardModel, boxes: jax.Array, mask: jax.Array, active: jax.Array
) -> jax.Array:
    graphs = jax.vmap(partial(build_graph, objects), in_axes=(0, None, 0))(boxes, mask, active)
    return jax.vmap(model.apply)(graphs)
