"""The audit: its shares by hand, on a reward whose values are known."""

from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from graphrl_jax.reward import landscape as audits
from graphrl_jax.reward.landscape import Grid, Landscape, Scenes, audit, trajectory_scores
from tests.helpers.demonstrations import demonstrations
from tests.helpers.graphs import OBJECTS


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Nearness:
    """Stands in for a learned reward: minus the distance of the block (slot 1) to a place."""

    place: jax.Array

    def apply(self, graph) -> jax.Array:
        return -jnp.linalg.norm(graph.boxes[1, :2] - self.place)


def scenes(blocks: np.ndarray, active: np.ndarray) -> Scenes:
    """Boxes (..., 4, 4) with the block's centre at `blocks` (..., 2), which is the state as well."""
    boxes = np.full((*blocks.shape[:-1], 4, 4), 0.1, np.float32)
    boxes[..., 1, :2] = blocks
    return Scenes(boxes, active, blocks)


@pytest.fixture
def carry() -> Landscape:
    x, y = np.linspace(0, 1, 5, dtype=np.float32), np.linspace(0, 1, 3, dtype=np.float32)
    places = np.stack(np.meshgrid(x, y), -1)
    goal = np.array([0.75, 0.5])
    random = np.random.default_rng(0).uniform(size=(30, 2)).astype(np.float32)
    near = goal + np.array([[0.0, 0.01], [0.02, 0.0]])
    active = np.array([True, True, False, False])
    inside = np.linalg.norm(places - goal, axis=-1) < 0.2
    grid = Grid("block", scenes(places, active), x, y, inside, np.zeros((4, 2)), np.zeros(2))
    each = np.broadcast_to(active, (2, 4))
    return Landscape(
        OBJECTS, np.array([True, True, True, False]), (grid,), scenes(random, np.broadcast_to(active, (30, 4))),
        np.linalg.norm(random - goal, axis=-1), scenes(near, active), scenes(near - 0.5, active),
        scenes(near, each), scenes(near + 0.25, each),
    )  # fmt: skip


def test_a_perfect_reward_passes_and_a_misplaced_one_fails(carry):
    perfect = audit(Nearness(jnp.array([0.75, 0.5])), carry)
    shares = {"pair_accuracy": 1.0, "finished_above_unfinished": 1.0, "maxima_inside": 1.0}
    assert perfect.metrics() == {**shares, "within_above_beside": 1.0, "bump_bonus": 0.0}
    np.testing.assert_allclose(perfect.grids[0].maximum, [0.75, 0.5])
    assert perfect.grids[0].values.shape == (3, 5)
    misplaced = audit(Nearness(jnp.array([0.0, 0.0])), carry)
    assert misplaced.maxima_inside == misplaced.finished_above_unfinished == 0.0
    assert misplaced.pair_accuracy < 0.6
    assert audit(Nearness(jnp.array([1.0, 0.75])), carry).within_above_beside == 0.0


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Activity:
    """Stands in for a reward that pays for activity: a different sum for every slot."""

    pays: jax.Array

    def apply(self, graph) -> jax.Array:
        return jnp.sum(self.pays * graph.active)


def test_the_bonus_for_bumping_counts_what_never_moved_and_is_neither_robot_nor_fixture(carry):
    objects = replace(OBJECTS, is_robot=(True, False, False, False), is_fixture=(False, False, False, True))
    random = replace(carry.random, active=np.zeros((30, 4), bool) | np.eye(4, dtype=bool)[1])
    landscape = replace(carry, objects=objects, random=random)
    # Slot 0 is the robot, slot 1 has moved already, slot 3 is scenery.
    assert audit(Activity(jnp.array([1.0, 2.0, 4.0, 8.0])), landscape).bump_bonus == pytest.approx(4.0)


def test_trajectories_are_held_to_the_longest_ones_end(monkeypatch):
    demos = demonstrations(num=3, num_frames=5)
    demos = replace(demos, lengths=np.array([5, 3, 2], np.int32), success=np.array([True, True, False]))
    rewards = np.array([[-3, -2, -1, -1, 0], [-1, -1, -1, 99, 99], [-1, -2, 99, 99, 99]], np.float32)
    monkeypatch.setattr(audits, "demonstration_rewards", lambda model, demos: rewards)
    report = trajectory_scores(None, demos, discount=0.5)
    assert report["by_kind"]["success"]["undiscounted"] == pytest.approx((-7 - 5) / 2)
    assert report["by_kind"]["failure"]["undiscounted"] == pytest.approx(-1 - 2 * 4)
    assert report["by_kind"]["failure"]["discounted"] == pytest.approx(-1 - 2 * (0.5 + 0.25 + 0.125 + 0.0625))
    assert report["by_kind"]["success"]["end"] == pytest.approx((0 - 1) / 2)
    assert report["by_kind"]["failure"]["end"] == pytest.approx(-2)
    assert report["successes_above"] == {"undiscounted": 1.0, "discounted": 0.5, "by_kind": {"failure": 1.0}}
    # Or to the end of an episode, be it later or earlier.
    for horizon, success, failure in ((7, (-7 - 7) / 2, -1 - 2 * 6), (3, (-6 - 3) / 2, -1 - 2 * 2)):
        sums = trajectory_scores(None, demos, horizon=horizon)["by_kind"]
        assert sums["success"]["undiscounted"] == pytest.approx(success)
        assert sums["failure"]["undiscounted"] == pytest.approx(failure)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Brightness:
    """Stands in for a reward of images: their brightness, times a factor."""

    factor: jax.Array

    def apply(self, image) -> jax.Array:
        return self.factor * jnp.mean(image)


def draw_place(place: jax.Array) -> jax.Array:
    """An image (2, 2, 3) as bright as the block is far east and south."""
    return jnp.broadcast_to(jnp.sum(place), (2, 2, 3))


def test_a_reward_of_images_is_shown_what_is_drawn(carry):
    report = audit(Brightness(jnp.array(2.0)), carry, draw_place)
    np.testing.assert_allclose(report.grids[0].values, 2 * carry.grids[0].scenes.states.sum(-1), rtol=1e-5)
    np.testing.assert_allclose(report.grids[0].maximum, [1.0, 1.0])
    assert report.bump_bonus == 0.0  # images know of no activity
