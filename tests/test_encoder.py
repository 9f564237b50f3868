"""The encoder: equations, masks, symmetries."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from synthetic import OBJECTS, overwrite_slot, permute, random_graph

from graphrl_jax import encoder
from graphrl_jax.encoder import EncoderConfig
from graphrl_jax.graph import pad_graph, sequence_graphs

CONFIG = EncoderConfig(num_layers=2, hidden=6, embedding=5)
INIT = jax.jit(encoder.init, static_argnums=(1, 2))
PARAMS = INIT(jax.random.key(0), CONFIG, 3)
ENCODE = jax.jit(encoder.encode)
NODES = jax.jit(encoder.encode_nodes)
POOL = jax.jit(encoder.pool)
WEIGHTS = jax.jit(encoder.pooling_weights)
PAD = jax.jit(pad_graph, static_argnums=1)


def close(actual, expected):
    np.testing.assert_allclose(actual, expected, rtol=1e-4, atol=1e-5)


def test_shapes_and_dtypes():
    graph = random_graph(0)
    assert NODES(PARAMS, graph).shape == (5, 6)
    assert ENCODE(PARAMS, graph, 2.0, 1.0).shape == (5,)
    assert ENCODE(PARAMS, graph, 2.0, 1.0).dtype == jnp.float32


def test_node_embeddings_equal_messages_computed_edge_by_edge():
    graph = random_graph(1)
    params = jax.tree.map(np.asarray, PARAMS)
    boxes, classes = np.asarray(graph.boxes), np.asarray(graph.classes)
    present = np.flatnonzero(graph.mask)
    linear = params["input"][0]
    scaled = 5.0 * (boxes - 0.5)
    nodes = {i: relu(np.concatenate([classes[i], scaled[i]]) @ linear["weight"] + linear["bias"]) for i in present}
    for layer in params["layers"]:
        updated = {}
        for i in present:
            messages = []
            for j in present:
                if j != i:
                    offset = 5.0 * (boxes[j, :2] - boxes[i, :2])
                    inputs = np.concatenate([nodes[i], nodes[j], offset, [np.linalg.norm(offset)]])
                    weight = np.concatenate([layer["receiver"], layer["sender"], layer["edge"]])
                    # The message's second layer stands after the mean in the encoder and before it here.
                    messages.append(relu(inputs @ weight + layer["message_bias"]) @ layer["messages"])
            update = nodes[i] @ layer["own"] + np.mean(messages, axis=0) + layer["update_bias"]
            updated[i] = nodes[i] + relu(update) @ layer["output"]
        nodes = updated
    close(np.asarray(NODES(PARAMS, graph))[present], np.stack([nodes[i] for i in present]))


def relu(values):
    return np.maximum(values, 0)


def test_weights_are_those_of_equation_1():
    graph = replace(
        random_graph(0, 6),
        mask=np.array([1, 1, 1, 1, 0, 0], bool),
        robot=np.array([1, 1, 0, 0, 0, 1], bool),
        active=np.array([0, 1, 0, 1, 1, 1], bool),
    )
    close(WEIGHTS(graph, 3.0, 1.0), [0, 0, 1, 3, 0, 0])
    close(WEIGHTS(graph, 3.0, 0.0), [1, 3, 1, 3, 0, 0])


def test_pooling_is_the_weighted_mean_of_equation_2():
    graph = random_graph(0)  # slot 0 robot, slot 1 active, slot 4 masked
    nodes = np.random.default_rng(0).normal(size=(5, 6)).astype(np.float32)
    close(POOL(nodes, graph, 3.0, 1.0), (3 * nodes[1] + nodes[2] + nodes[3]) / 5)
    close(POOL(nodes, graph, 3.0, 0.0), (nodes[0] + 3 * nodes[1] + nodes[2] + nodes[3]) / 6)


def test_alpha_one_is_the_plain_mean_over_non_robot_nodes():
    graph = random_graph(2)
    nodes = np.asarray(NODES(PARAMS, graph))
    kept = graph.mask & ~graph.robot
    close(POOL(nodes, graph, 1.0, 1.0), np.mean(nodes[kept], axis=0))
    close(POOL(nodes, graph, 1.0, 0.0), np.mean(nodes[graph.mask], axis=0))


def test_a_robot_without_messages_is_as_good_as_absent():
    graph = random_graph(0)  # slot 0 is the robot
    absent = replace(graph, mask=graph.mask & ~graph.robot)
    close(ENCODE(PARAMS, graph, 2.0, 1.0, 0.0), ENCODE(PARAMS, absent, 2.0, 1.0, 1.0))
    assert not np.allclose(ENCODE(PARAMS, graph, 2.0, 1.0, 1.0), ENCODE(PARAMS, absent, 2.0, 1.0, 1.0), atol=1e-4)


@settings(max_examples=10, deadline=None)
@given(st.permutations(range(5)), st.integers(0, 2**16))
def test_order_of_nodes_does_not_matter(order, seed):
    graph = random_graph(seed)
    close(ENCODE(PARAMS, permute(graph, np.array(order)), 2.0, 1.0), ENCODE(PARAMS, graph, 2.0, 1.0))


@settings(max_examples=5, deadline=None)
@given(st.integers(0, 2**16))
def test_padding_does_not_matter(seed):
    graph = random_graph(seed)
    close(ENCODE(PARAMS, PAD(graph, 8), 2.0, 1.0), ENCODE(PARAMS, graph, 2.0, 1.0))


@pytest.mark.parametrize("garbage", [1e30, -1e30, np.nan, np.inf])
def test_what_stands_in_a_masked_slot_does_not_matter(garbage):
    graph = random_graph(3)
    dirty = overwrite_slot(graph, 4, garbage)
    for suppress_robot in (0.0, 1.0):
        np.testing.assert_array_equal(
            ENCODE(PARAMS, dirty, 2.0, suppress_robot), ENCODE(PARAMS, graph, 2.0, suppress_robot)
        )
    gradients = GRADIENTS(PARAMS, dirty, 2.0, 1.0)
    jax.tree.map(np.testing.assert_array_equal, gradients[0], GRADIENTS(PARAMS, graph, 2.0, 1.0)[0])
    np.testing.assert_array_equal(np.asarray(gradients[1])[4], 0.0)


def loss(params, graph, boxes, alpha, suppress_robot):
    return jnp.sum(encoder.encode(params, replace(graph, boxes=boxes), alpha, suppress_robot) ** 2)


@jax.jit
def GRADIENTS(params, graph, alpha, suppress_robot):
    return jax.grad(loss, argnums=(0, 2))(params, graph, graph.boxes, alpha, suppress_robot)


@pytest.mark.parametrize("case", ["all masked", "robot only", "all active at alpha 0"])
def test_zero_total_weight_pools_to_zero_with_finite_gradients(case):
    graph, alpha = random_graph(4), 2.0
    if case == "all masked":
        graph = replace(graph, mask=np.zeros(5, bool))
    elif case == "robot only":
        graph = replace(graph, robot=np.ones(5, bool))
    else:
        graph, alpha = replace(graph, active=np.ones(5, bool)), 0.0
    np.testing.assert_array_equal(POOL(NODES(PARAMS, graph), graph, alpha, 1.0), np.zeros(6))
    assert np.isfinite(ENCODE(PARAMS, graph, alpha, 1.0)).all()
    for gradient in jax.tree.leaves(GRADIENTS(PARAMS, graph, alpha, 1.0)):
        assert np.isfinite(gradient).all()


def test_a_single_node_without_neighbours_is_finite():
    graph = replace(random_graph(5), mask=np.arange(5) == 2)
    assert np.isfinite(ENCODE(PARAMS, graph, 2.0, 1.0)).all()
    for gradient in jax.tree.leaves(GRADIENTS(PARAMS, graph, 2.0, 1.0)):
        assert np.isfinite(gradient).all()


def test_changing_alpha_or_the_robot_switch_does_not_trace_again():
    traces = []

    @jax.jit
    def counted(alpha, suppress_robot):
        traces.append(alpha)
        return encoder.encode(PARAMS, random_graph(0), alpha, suppress_robot)

    results = [counted(alpha, suppress_robot) for alpha in (1.0, 5.0) for suppress_robot in (0.0, 1.0)]
    assert len(traces) == 1
    assert len({float(np.asarray(result)[0]) for result in results}) == 4


def test_encoding_a_sequence_equals_encoding_its_frames():
    boxes = np.random.default_rng(0).uniform(0, 1, (4, 4, 4)).astype(np.float32)
    boxes[3] = 1e30
    mask = np.ones((4, 4), bool)
    sequence = jax.jit(encoder.encode_sequence, static_argnums=1)(PARAMS, OBJECTS, boxes, mask, 3, 2.0, 1.0, 0.1)
    sequence = np.asarray(sequence)
    graphs = jax.tree.map(np.asarray, jax.jit(sequence_graphs, static_argnums=0)(OBJECTS, boxes, mask, 3, 0.1))
    for t in range(3):
        close(sequence[t], ENCODE(PARAMS, jax.tree.map(lambda field, t=t: field[t], graphs), 2.0, 1.0))
    assert np.isfinite(sequence[3]).all()


@pytest.mark.parametrize("layers, head_layers", [(0, 0), (1, 2)])
def test_sizes_follow_the_configuration(layers, head_layers):
    config = EncoderConfig(num_layers=layers, hidden=4, embedding=3, head_layers=head_layers)
    params = jax.eval_shape(lambda: encoder.init(jax.random.key(1), config, 3))
    assert len(params["layers"]) == layers and len(params["head"]) == head_layers + 1
    assert jax.eval_shape(encoder.encode, params, random_graph(0), 1.0, 1.0).shape == (3,)


@pytest.mark.parametrize("field, value", [("num_layers", -1), ("hidden", 0), ("embedding", 0), ("head_layers", -1)])
def test_a_wrong_size_names_the_field(field, value):
    with pytest.raises(ValueError, match=f"EncoderConfig.{field} must be at least .*, got {value}"):
        EncoderConfig(**{field: value})
