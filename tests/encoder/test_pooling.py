"""Weighted pooling: Eq. 1 and 2, its corner cases, and what changes without compiling."""

from dataclasses import fields, replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from graphrl_jax.encoder import encoder
from graphrl_jax.encoder.config import ACTIVITY_RULES, EncoderConfig
from graphrl_jax.encoder.pooling import PoolingParams, pool, weights
from graphrl_jax.graph import sequence_graphs
from tests.helpers.graphs import OBJECTS, overwrite_slot, pad, random_graph

CONFIG = EncoderConfig(num_layers=1, hidden=6, embedding=5)
PARAMS = jax.jit(encoder.init, static_argnums=(1, 2))(jax.random.key(0), CONFIG, OBJECTS)
POOL = jax.jit(pool)
WEIGHTS = jax.jit(weights)
ENCODE = jax.jit(encoder.encode)
NODES = np.random.default_rng(0).normal(size=(5, 6)).astype(np.float32)


def close(actual, expected):
    np.testing.assert_allclose(actual, expected, rtol=1e-4, atol=1e-5)


def test_weights_are_those_of_equation_1():
    graph = replace(
        random_graph(0, 6),
        mask=np.array([1, 1, 1, 1, 0, 0], bool),
        robot=np.array([1, 1, 0, 0, 0, 1], bool),
        active=np.array([0, 1, 0, 1, 1, 1], bool),
    )
    close(WEIGHTS(graph, PoolingParams(3.0, 1.0)), [0, 0, 1, 3, 0, 0])
    close(WEIGHTS(graph, PoolingParams(3.0, 0.0)), [1, 3, 1, 3, 0, 0])


def test_pooling_is_the_weighted_mean_of_equation_2():
    graph = random_graph(0)  # slot 0 robot, slot 1 active, slot 4 masked
    close(POOL(NODES, graph, PoolingParams(3.0, 1.0)), (3 * NODES[1] + NODES[2] + NODES[3]) / 5)
    close(POOL(NODES, graph, PoolingParams(3.0, 0.0)), (NODES[0] + 3 * NODES[1] + NODES[2] + NODES[3]) / 6)


def test_alpha_one_is_the_plain_mean_over_non_robot_nodes():
    graph = random_graph(2)
    kept = graph.mask & ~graph.robot
    close(POOL(NODES, graph, PoolingParams(1.0, 1.0)), np.mean(NODES[kept], axis=0))
    close(POOL(NODES, graph, PoolingParams(1.0, 0.0)), np.mean(NODES[graph.mask], axis=0))


def test_the_weights_share_is_all_that_counts():
    graph = replace(random_graph(2), active=random_graph(2).mask)
    close(POOL(NODES, graph, PoolingParams(7.0, 1.0)), POOL(NODES, graph, PoolingParams(1.0, 1.0)))


@pytest.mark.parametrize("garbage", [1e30, np.nan])
def test_masked_slots_and_padding_take_part_in_nothing(garbage):
    graph, pooling = random_graph(3), PoolingParams(3.0, 1.0)
    nodes = NODES.copy()
    nodes[4] = garbage
    expected = POOL(NODES, graph, pooling)
    np.testing.assert_array_equal(POOL(nodes, overwrite_slot(graph, 4, garbage), pooling), expected)
    padded = np.full((8, 6), garbage, np.float32)
    padded[:4] = NODES[:4]
    close(POOL(padded, pad(graph, 8), pooling), expected)
    np.testing.assert_array_equal(np.asarray(WEIGHTS(pad(graph, 8), pooling))[5:], 0.0)


@pytest.mark.parametrize("case", ["all masked", "robot only", "all active at alpha 0"])
def test_a_graph_of_zero_total_weight_pools_to_zero(case):
    graph, alpha = random_graph(4), 2.0
    if case == "all masked":
        graph = replace(graph, mask=np.zeros(5, bool))
    elif case == "robot only":
        graph = replace(graph, robot=np.ones(5, bool))
    else:
        graph, alpha = replace(graph, active=np.ones(5, bool)), 0.0
    pooling = PoolingParams(alpha, 1.0)
    np.testing.assert_array_equal(POOL(NODES, graph, pooling), np.zeros(6))
    for gradient in jax.tree.leaves(GRADIENTS(NODES, graph, pooling)):
        assert np.isfinite(gradient).all()


@jax.jit
def GRADIENTS(nodes, graph, pooling):
    return jax.grad(lambda nodes, pooling: jnp.sum(pool(nodes, graph, pooling) ** 2), argnums=(0, 1))(nodes, pooling)


def test_keywords_mean_the_same_in_any_order():
    values = {"alpha": 3.0, "suppress_robot": 0.5, "robot_messages": 0.25, "tau": 0.1, "activity": "momentary"}
    assert [field.name for field in fields(PoolingParams)] == list(values)
    pooling = PoolingParams(**dict(reversed(values.items())))
    assert pooling == PoolingParams(**values)
    for name, value in values.items():
        assert getattr(pooling, name) == value
    graph = random_graph(0)
    close(WEIGHTS(graph, pooling), [0.5, 3, 1, 1, 0])


def test_another_float_compiles_nothing_and_each_says_something_of_its_own():
    boxes = np.tile(np.random.default_rng(1).uniform(0, 0.5, (4, 4)).astype(np.float32), (3, 1, 1))
    boxes[1:, 1, 0] += 0.3
    mask = np.ones((3, 4), bool)
    start = PoolingParams(alpha=2.0, suppress_robot=0.5, robot_messages=0.5, tau=0.02)
    traces = []

    @jax.jit
    def counted(pooling):
        traces.append(pooling)
        return encoder.encode_sequence(PARAMS, OBJECTS, boxes, mask, 3, pooling)[-1]

    changes = [{}, {"alpha": 5.0}, {"suppress_robot": 1.0}, {"robot_messages": 0.0}, {"tau": 10.0}]
    found = {tuple(np.asarray(counted(replace(start, **change))).tolist()) for change in changes}
    assert len(traces) == 1 and len(found) == len(changes)
    counted(replace(start, alpha=np.float32(3.0), tau=np.float32(0.1)))
    assert len(traces) == 2  # a float and an array are of different types
    counted(replace(start, activity="frame_motion"))
    assert len(traces) == 3


def test_a_batch_of_poolings_is_mapped_over():
    graph = random_graph(0)
    alphas = np.array([1.0, 2.0, 4.0], np.float32)
    pooling = jax.tree.map(lambda value: np.full(3, value, np.float32), PoolingParams())
    mapped = jax.jit(jax.vmap(pool, in_axes=(None, None, 0)))(NODES, graph, replace(pooling, alpha=alphas))
    for alpha, pooled in zip(alphas, mapped, strict=True):
        close(pooled, POOL(NODES, graph, PoolingParams(float(alpha))))


def test_the_rule_of_activity_is_part_of_the_program():
    structures = {jax.tree.structure(PoolingParams(activity=rule)) for rule in ACTIVITY_RULES}
    assert len(jax.tree.leaves(PoolingParams())) == 4 and len(structures) == len(ACTIVITY_RULES)
    with pytest.raises(ValueError, match="PoolingParams.activity is 'x'; allowed: displacement, frame_motion, mom"):
        PoolingParams(activity="x")
    # The block creeps and then rests: no frame shows much motion, together they do.
    boxes = np.full((4, 4, 4), 0.1, np.float32)
    boxes[:, 1, 0] = [0.1, 0.11, 0.12, 0.12]
    boxes[1:, 2, 0] = 0.5
    mask = np.ones((4, 4), bool)
    frames = jax.jit(sequence_graphs, static_argnums=(0, 6))
    active = {"displacement": [True, True], "frame_motion": [False, True], "momentary": [False, False]}
    for rule in ACTIVITY_RULES:
        pooling = PoolingParams(alpha=9.0, tau=0.1, activity=rule)
        graphs = frames(OBJECTS, boxes, mask, 4, pooling.tau, None, rule)
        graph = jax.tree.map(lambda field: np.asarray(field)[3], graphs)
        np.testing.assert_array_equal(graph.active[1:3], active[rule])
        sequence = jax.jit(encoder.encode_sequence, static_argnums=1)(PARAMS, OBJECTS, boxes, mask, 4, pooling)
        close(np.asarray(sequence)[3], ENCODE(PARAMS, graph, pooling))
