"""Object tables, edges, activity and masks."""

import subprocess
import sys

import jax
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from graphrl_jax.graph import (
    ObjectTable,
    activity,
    build_graph,
    clear_masked_slots,
    edge_features,
    sequence_graphs,
    update_activity,
)
from tests.helpers.graphs import OBJECTS, overwrite_slot, random_graph

TABLE = dict(names=("a", "b"), class_ids=(0, 1), is_robot=(True, False), class_names=("x", "y"))
ACTIVITY = jax.jit(activity, static_argnames="persistent")
UPDATE_ACTIVITY = jax.jit(update_activity)


@pytest.mark.parametrize(
    ("field", "value", "says"),
    [
        ("names", (), "names must hold at least one name"),
        ("names", ("a", "a"), "no name twice"),
        ("names", "ab", "names must be a sequence of str, got the string 'ab'"),
        ("names", ("a", 3), "names must hold str values only, got 3"),
        ("class_ids", (0,), "class_ids has 1 entries, but names has 2"),
        ("class_ids", (0, 2), "class_ids holds 2; allowed are 0 to 1"),
        ("class_ids", (0, -1), "class_ids holds -1; allowed are 0 to 1"),
        ("class_ids", (0, 1.0), "class_ids must hold int values only, got 1.0"),
        ("is_robot", (True,), "is_robot has 1 entries"),
        ("is_robot", (1, 0), "is_robot must hold bool values only, got 1"),
        ("is_fixture", (True,), "is_fixture has 1 entries"),
        ("class_names", ("x", "x"), "no name twice"),
    ],
)
def test_a_wrong_object_table_names_the_field(field, value, says):
    with pytest.raises(ValueError, match=f"ObjectTable.{says}" if not says.startswith("no ") else says):
        ObjectTable(**{**TABLE, field: value})


def test_object_table_is_hashable_and_takes_lists_and_numpy_values():
    table = ObjectTable(["a", "b"], np.array([0, 1]), np.array([True, False]), ["x", "y"])
    assert table == ObjectTable(**TABLE) and hash(table) == hash(ObjectTable(**TABLE))
    assert (table.num_slots, table.num_classes) == (2, 2)


def test_class_one_hot_and_robot_flags():
    one_hot, robot = OBJECTS.class_one_hot(), OBJECTS.robot_flags()
    assert one_hot.dtype == np.float32 and robot.dtype == bool
    np.testing.assert_array_equal(one_hot, [[1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 1, 0]])
    np.testing.assert_array_equal(robot, [True, False, False, False])


def test_nothing_is_a_fixture_unless_it_is_said():
    np.testing.assert_array_equal(ObjectTable(**TABLE).fixture_flags(), [False, False])
    np.testing.assert_array_equal(ObjectTable(**TABLE, is_fixture=(False, True)).fixture_flags(), [False, True])


def test_build_graph_states_the_shapes_it_takes():
    with pytest.raises(ValueError, match=r"takes boxes \(4, 4\).*got \(2, 4, 4\)"):
        build_graph(OBJECTS, np.zeros((2, 4, 4)), np.zeros((2, 4), bool), np.zeros((2, 4), bool))


def test_edge_features_by_hand():
    boxes = np.array([[0.1, 0.2, 0.5, 0.5], [0.4, 0.6, 0.1, 0.1]], np.float32)
    edges = np.asarray(jax.jit(edge_features)(boxes))
    np.testing.assert_allclose(edges[0, 1], [0.3, 0.4, 0.5], rtol=1e-6)
    np.testing.assert_allclose(edges[1, 0], [-0.3, -0.4, 0.5], rtol=1e-6)
    np.testing.assert_array_equal(edges[0, 0], [0, 0, 0])


def test_gradient_of_edges_is_finite_where_centres_coincide():
    gradient = jax.jit(jax.grad(lambda boxes: edge_features(boxes).sum()))(np.ones((3, 4), np.float32))
    assert np.isfinite(gradient).all()


def test_activity_compares_the_step_with_the_box_diagonal():
    # Diagonal 0.5, threshold 0.1: steps above 0.05 count.
    boxes = np.tile(np.array([0.0, 0.0, 0.3, 0.4], np.float32), (4, 2, 1))
    boxes[1:, 0, 0] = 0.049
    boxes[2:, 1, 0] = 0.051
    flags = ACTIVITY(boxes, np.ones((4, 2), bool), 0.1)
    np.testing.assert_array_equal(flags, [[0, 0], [0, 0], [0, 1], [0, 1]])


def test_activity_persists_and_is_kept_while_the_object_is_absent():
    boxes = np.full((5, 1, 4), 0.1, np.float32)
    boxes[1, 0, 0] = 0.9
    mask = np.array([[True], [True], [False], [False], [True]])
    np.testing.assert_array_equal(np.asarray(ACTIVITY(boxes, mask, 0.1))[:, 0], [0, 1, 1, 1, 1])


@pytest.mark.parametrize("absent", [0, 1])
def test_an_object_masked_now_or_one_frame_ago_cannot_switch_on(absent):
    boxes = np.zeros((2, 1, 4), np.float32)
    boxes[absent] = 1e30
    boxes[1 - absent] = 0.1
    mask = np.ones((2, 1), bool)
    mask[absent] = False
    assert not np.any(ACTIVITY(boxes, mask, 0.1))


def test_a_box_without_extent_switches_on_when_it_moves_only():
    still = np.zeros((2, 1, 4), np.float32)
    moving = still.copy()
    moving[1, 0, 0] = 0.01
    mask = np.ones((2, 1), bool)
    assert not np.any(ACTIVITY(still, mask, 0.1))
    np.testing.assert_array_equal(np.asarray(ACTIVITY(moving, mask, 0.1))[:, 0], [False, True])


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**16), st.floats(0.0, 1.0))
def test_activity_equals_a_loop_and_steps_of_update_activity(seed, tau):
    random = np.random.default_rng(seed)
    boxes = random.uniform(0, 1, (6, 3, 4)).astype(np.float32)
    mask = random.uniform(size=(6, 3)) < 0.7
    expected = np.zeros((6, 3), bool)
    steps = [np.zeros(3, bool)]
    for t in range(1, 6):
        for i in range(3):
            moved = np.linalg.norm(boxes[t, i, :2] - boxes[t - 1, i, :2]) / np.linalg.norm(boxes[t, i, 2:]) > tau
            expected[t, i] = expected[t - 1, i] or (moved and mask[t, i] and mask[t - 1, i])
        steps.append(UPDATE_ACTIVITY(steps[-1], boxes[t - 1], mask[t - 1], boxes[t], mask[t], tau))
    np.testing.assert_array_equal(ACTIVITY(boxes, mask, tau), expected)
    np.testing.assert_array_equal(np.stack(steps), expected)


def test_sequence_graphs_mask_everything_behind_the_length():
    boxes = np.random.default_rng(0).uniform(0, 1, (5, 4, 4)).astype(np.float32)
    graphs = jax.jit(sequence_graphs, static_argnums=0)(OBJECTS, boxes, np.ones((5, 4), bool), 3, 0.01)
    graphs = jax.tree.map(np.asarray, graphs)
    np.testing.assert_array_equal(graphs.mask, np.arange(5)[:, None] < np.array([3] * 4))
    np.testing.assert_array_equal(graphs.active[0], False)
    assert graphs.active[1].all() and graphs.classes.shape == (5, 4, 3)


def test_without_persistence_only_what_moves_is_active():
    boxes = np.full((4, 2, 4), 0.1, np.float32)
    boxes[:, 0, 0] = [0.2, 0.3, 0.3, 0.4]
    mask = np.ones((4, 2), bool)
    np.testing.assert_array_equal(ACTIVITY(boxes, mask, 0.1)[:, 0], [False, True, True, True])
    moving = ACTIVITY(boxes, mask, 0.1, persistent=False)
    np.testing.assert_array_equal(moving[:, 0], [False, True, False, True])
    assert not np.any(moving[:, 1])


@pytest.mark.parametrize("garbage", [1e30, np.nan])
def test_cleared_slots_hold_zeros_and_the_others_what_they_held(garbage):
    graph = random_graph(0)  # slot 4 is masked
    cleared = jax.tree.map(np.asarray, jax.jit(clear_masked_slots)(overwrite_slot(graph, 4, garbage)))
    for field in (cleared.boxes, cleared.classes, cleared.robot, cleared.active):
        assert not field[4].any()
    jax.tree.map(lambda new, old: np.testing.assert_array_equal(new[:4], old[:4]), cleared, graph)


def test_the_graph_is_imported_without_brax_flax_optax_or_mujoco():
    program = "import sys, graphrl_jax.graph; print({'brax', 'flax', 'optax', 'mujoco'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=120, check=True)
    assert done.stdout.strip() == "set()"
