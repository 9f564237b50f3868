"""Object tables, edges, activity and masks."""

import subprocess
import sys

import jax
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from graphrl_jax.encoder.config import ACTIVITY_RULES
from graphrl_jax.graph import (
    ObjectTable,
    activity,
    begin_activity,
    build_graph,
    clear_masked_slots,
    edge_features,
    sequence_graphs,
    update_activity,
)
from graphrl_jax.pretrain.config import PretrainHyper
from tests.helpers.graphs import OBJECTS, overwrite_slot, random_graph

TABLE = dict(names=("a", "b"), class_ids=(0, 1), is_robot=(True, False), class_names=("x", "y"))
ACTIVITY = jax.jit(activity, static_argnames="rule")
UPDATE_ACTIVITY = jax.jit(update_activity, static_argnames="rule")
TAU = PretrainHyper().tau


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


def flags_by_loop(boxes: np.ndarray, mask: np.ndarray, tau: float, rule: str) -> np.ndarray:
    """Activity (T, N) by loops over frames and slots."""
    flags = np.zeros(mask.shape, bool)
    for i in range(mask.shape[1]):
        for t in range(1, len(mask)):
            seen = np.flatnonzero(mask[:t, i])
            frames = seen[:1] if rule == "displacement" else seen[seen == t - 1]
            way = [np.linalg.norm(boxes[t, i, :2] - boxes[frame, i, :2]) for frame in frames]
            moved = mask[t, i] and any(way > tau * np.linalg.norm(boxes[t, i, 2:]))
            flags[t, i] = moved or (rule != "momentary" and flags[t - 1, i])
    return flags


@pytest.mark.parametrize("rule, expected", [("displacement", [0, 0, 1, 1]), ("frame_motion", [0, 0, 0, 0])])
def test_displacement_adds_up_steps_and_frame_motion_does_not(rule, expected):
    # Diagonal 0.5, threshold 0.1: a way above 0.05 counts. The second slot comes back and stays active.
    boxes = np.tile(np.array([0.0, 0.0, 0.3, 0.4], np.float32), (4, 3, 1))
    boxes[:, 0, 0] = [0.0, 0.03, 0.06, 0.09]
    boxes[:, 1, 1] = [0.0, 0.03, 0.06, 0.03]
    boxes[:, 2, 0] = [0.0, 0.03, 0.049, 0.03]
    flags = np.asarray(ACTIVITY(boxes, np.ones((4, 3), bool), 0.1, rule=rule))
    np.testing.assert_array_equal(flags.T, [expected, expected, [0, 0, 0, 0]])


@pytest.mark.parametrize("rule", ["displacement", "frame_motion"])
def test_activity_compares_the_way_with_the_box_diagonal(rule):
    # Diagonal 0.5, threshold 0.1: a step above 0.05 counts.
    boxes = np.tile(np.array([0.0, 0.0, 0.3, 0.4], np.float32), (4, 2, 1))
    boxes[1:, 0, 0] = 0.049
    boxes[2:, 1, 0] = 0.051
    flags = ACTIVITY(boxes, np.ones((4, 2), bool), 0.1, rule=rule)
    np.testing.assert_array_equal(flags, [[0, 0], [0, 0], [0, 1], [0, 1]])


def test_the_diagonal_is_that_of_the_current_box():
    boxes = np.tile(np.array([0.0, 0.0, 0.3, 0.4], np.float32), (2, 2, 1))
    boxes[1, :, 0] = 0.06
    boxes[1, 1, 2:] *= 2
    np.testing.assert_array_equal(ACTIVITY(boxes, np.ones((2, 2), bool), 0.1)[1], [True, False])


@pytest.mark.parametrize("rule", ["displacement", "frame_motion"])
def test_activity_persists_and_is_kept_while_the_object_is_absent(rule):
    boxes = np.full((5, 1, 4), 0.1, np.float32)
    boxes[1, 0, 0] = 0.9
    mask = np.array([[True], [True], [False], [False], [True]])
    np.testing.assert_array_equal(np.asarray(ACTIVITY(boxes, mask, 0.1, rule=rule))[:, 0], [0, 1, 1, 1, 1])


@pytest.mark.parametrize("garbage", [1e30, np.nan])
def test_an_object_first_seen_late_moves_from_where_it_was_first_seen(garbage):
    boxes = np.full((6, 1, 4), 0.1, np.float32)
    boxes[:, 0, 0] = [garbage, garbage, 0.5, garbage, 0.51, 0.7]
    mask = np.array([[False], [False], [True], [False], [True], [True]])
    np.testing.assert_array_equal(np.asarray(ACTIVITY(boxes, mask, 0.5))[:, 0], [0, 0, 0, 0, 0, 1])


def test_what_counts_as_moved_from_the_start_stays_active():
    boxes, mask = np.full((2, 4), 0.1, np.float32), np.ones(2, bool)
    state = begin_activity(boxes, mask, np.array([True, False]))
    for rule, expected in (("displacement", True), ("frame_motion", True), ("momentary", False)):
        np.testing.assert_array_equal(UPDATE_ACTIVITY(state, boxes, mask, 0.1, rule=rule).active, [expected, False])


@pytest.mark.parametrize("rule", ACTIVITY_RULES)
@pytest.mark.parametrize("absent", [0, 1])
def test_an_object_masked_now_or_in_every_frame_before_cannot_switch_on(absent, rule):
    boxes = np.zeros((2, 1, 4), np.float32)
    boxes[absent] = 1e30
    boxes[1 - absent] = 0.1
    mask = np.ones((2, 1), bool)
    mask[absent] = False
    assert not np.any(ACTIVITY(boxes, mask, 0.1, rule=rule))


@pytest.mark.parametrize("rule", ACTIVITY_RULES)
def test_a_box_without_extent_switches_on_when_it_moves_only(rule):
    still = np.zeros((2, 1, 4), np.float32)
    moving = still.copy()
    moving[1, 0, 0] = 0.01
    mask = np.ones((2, 1), bool)
    assert not np.any(ACTIVITY(still, mask, 0.1, rule=rule))
    np.testing.assert_array_equal(np.asarray(ACTIVITY(moving, mask, 0.1, rule=rule))[:, 0], [False, True])


@pytest.mark.parametrize("rule", ACTIVITY_RULES)
@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**16), st.floats(0.0, 1.0))
def test_activity_equals_a_loop_and_steps_of_update_activity(rule, seed, tau):
    random = np.random.default_rng(seed)
    boxes = random.uniform(0, 1, (6, 3, 4)).astype(np.float32)
    mask = random.uniform(size=(6, 3)) < 0.7
    expected = flags_by_loop(boxes, mask, tau, rule)
    state = begin_activity(boxes[0], mask[0])
    steps = [state.active]
    for t in range(1, 6):
        state = UPDATE_ACTIVITY(state, boxes[t], mask[t], tau, rule=rule)
        steps.append(state.active)
    np.testing.assert_array_equal(ACTIVITY(boxes, mask, tau, rule=rule), expected)
    np.testing.assert_array_equal(np.stack(steps), expected)


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**16), st.sampled_from([2, 3, 4, 6]))
def test_flags_of_a_path_are_the_same_at_every_frame_rate(seed, every):
    # From place to place on a line, so that the farthest place of each stretch is one of the kept frames.
    random = np.random.default_rng(seed)
    boxes = random.uniform(0.05, 0.2, (1, 5, 4)).repeat(61, axis=0)
    stops = np.cumsum(random.uniform(-0.02, 0.02, (6, 5)), axis=0)
    boxes[:, :, 0] += np.stack([np.interp(np.arange(61), np.arange(0, 61, 12), way) for way in stops.T], axis=1)
    boxes, mask = boxes.astype(np.float32), np.ones((61, 5), bool)
    whole = np.asarray(ACTIVITY(boxes, mask, 0.1))
    kept = np.asarray(ACTIVITY(boxes[::every], mask[::every], 0.1))
    np.testing.assert_array_equal(kept[-1], whole[-1])
    np.testing.assert_array_equal(kept, whole[::every])
    assert (whole[1:] >= whole[:-1]).all()


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**16))
def test_jitter_of_a_detector_is_no_motion_at_the_default_threshold(seed):
    random = np.random.default_rng(seed)
    still = random.uniform(0.15, 0.3, (8, 4))
    boxes = still + 0.02 * np.tile(still[:, 2:], 2) * random.normal(size=(500, 8, 4))
    boxes, mask = boxes.astype(np.float32), np.ones((500, 8), bool)
    assert not np.any(ACTIVITY(boxes, mask, TAU))
    # The rule that compares two frames takes the same jitter for motion, at the threshold that it needs.
    assert np.asarray(ACTIVITY(boxes, mask, 0.02, rule="frame_motion"))[-1].all()


def test_sequence_graphs_mask_everything_behind_the_length():
    boxes = np.random.default_rng(0).uniform(0, 1, (5, 4, 4)).astype(np.float32)
    graphs = jax.jit(sequence_graphs, static_argnums=0)(OBJECTS, boxes, np.ones((5, 4), bool), 3, 0.01)
    graphs = jax.tree.map(np.asarray, graphs)
    np.testing.assert_array_equal(graphs.mask, np.arange(5)[:, None] < np.array([3] * 4))
    np.testing.assert_array_equal(graphs.active[0], False)
    assert graphs.active[1].all() and graphs.classes.shape == (5, 4, 3)


def test_a_momentary_flag_is_set_while_the_object_moves_only():
    boxes = np.full((4, 2, 4), 0.1, np.float32)
    boxes[:, 0, 0] = [0.2, 0.3, 0.3, 0.4]
    mask = np.ones((4, 2), bool)
    np.testing.assert_array_equal(ACTIVITY(boxes, mask, 0.1)[:, 0], [False, True, True, True])
    moving = ACTIVITY(boxes, mask, 0.1, rule="momentary")
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
