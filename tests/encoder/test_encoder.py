"""The way from a graph, or an image, to its embedding: masks, symmetries, and which network goes it."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from jax.extend.core import jaxprs_in_params

from graphrl_jax.encoder import encoder, interaction, layers, message_passing, pixels
from graphrl_jax.encoder.config import EncoderConfig, PixelConfig
from graphrl_jax.encoder.interaction import InteractionParams
from graphrl_jax.encoder.message_passing import MessagePassingParams
from graphrl_jax.encoder.pixels import PixelParams
from graphrl_jax.encoder.pooling import PoolingParams, pool
from graphrl_jax.graph import sequence_graphs
from tests.helpers.graphs import OBJECTS, overwrite_slot, pad, permute, random_graph

CONFIG = EncoderConfig(num_layers=2, hidden=6, embedding=5)
INIT = jax.jit(encoder.init, static_argnums=(1, 2))
PARAMS = INIT(jax.random.key(0), CONFIG, OBJECTS)
ENCODE = jax.jit(encoder.encode)
NODES = jax.jit(encoder.encode_nodes)
POOL = jax.jit(pool)
POOLING = PoolingParams(alpha=2.0, suppress_robot=1.0)


def close(actual, expected):
    np.testing.assert_allclose(actual, expected, rtol=1e-4, atol=1e-5)


def test_shapes_and_dtypes():
    graph = random_graph(0)
    assert NODES(PARAMS, graph).shape == (5, 6)
    assert ENCODE(PARAMS, graph, POOLING).shape == (5,)
    assert ENCODE(PARAMS, graph, POOLING).dtype == jnp.float32


def products(jaxpr) -> list:
    """Precisions of all matrix products and convolutions, also of those in nested programs."""
    found = []
    for equation in jaxpr.eqns:
        if equation.primitive.name in ("dot_general", "conv_general_dilated"):
            found.append(equation.params["precision"])
        for inner in jaxprs_in_params(equation.params):
            found += products(inner)
    return found


@pytest.mark.parametrize("kind", ["message_passing", "interaction", "pixels"])
def test_matrix_products_have_full_precision_on_every_device(kind):
    config = replace(CONFIG, kind=kind)
    params = encoder.init(jax.random.key(0), config, OBJECTS)
    graph, image = random_graph(0, OBJECTS.num_slots), jnp.zeros((config.pixels.size, config.pixels.size, 3))
    seen = image if kind == "pixels" else graph
    found = products(jax.make_jaxpr(encoder.encode)(params, seen, POOLING).jaxpr)
    highest = jax.lax.Precision.HIGHEST
    assert len(found) > 2 and all(one in (highest, (highest, highest)) for one in found)


def test_every_step_of_the_way_is_handed_over():
    graph = random_graph(0)
    steps = jax.jit(encoder.embed)(PARAMS, graph, POOLING)
    close(steps.nodes, NODES(PARAMS, graph))
    close(steps.pooled, POOL(np.asarray(steps.nodes), graph, POOLING))
    close(steps.graph, jax.jit(layers.perceptron)(PARAMS.head, steps.pooled))
    close(steps.graph, ENCODE(PARAMS, graph, POOLING))


def test_a_robot_without_messages_is_as_good_as_absent():
    graph = random_graph(0)  # slot 0 is the robot
    absent = replace(graph, mask=graph.mask & ~graph.robot)
    unheard = replace(POOLING, robot_messages=0.0)
    close(ENCODE(PARAMS, graph, unheard), ENCODE(PARAMS, absent, POOLING))
    assert not np.allclose(ENCODE(PARAMS, graph, POOLING), ENCODE(PARAMS, absent, POOLING), atol=1e-4)


@settings(max_examples=10, deadline=None)
@given(st.permutations(range(5)), st.integers(0, 2**16))
def test_order_of_nodes_does_not_matter(order, seed):
    graph = random_graph(seed)
    close(ENCODE(PARAMS, permute(graph, np.array(order)), POOLING), ENCODE(PARAMS, graph, POOLING))


@settings(max_examples=5, deadline=None)
@given(st.integers(0, 2**16))
def test_padding_does_not_matter(seed):
    graph = random_graph(seed)
    close(ENCODE(PARAMS, pad(graph, 8), POOLING), ENCODE(PARAMS, graph, POOLING))
    close(np.asarray(NODES(PARAMS, pad(graph, 8)))[:4], np.asarray(NODES(PARAMS, graph))[:4])


@pytest.mark.parametrize("garbage", [1e30, -1e30, np.nan, np.inf])
def test_what_stands_in_a_masked_slot_does_not_matter(garbage):
    graph = random_graph(3)
    dirty = overwrite_slot(graph, 4, garbage)
    for suppress_robot in (0.0, 1.0):
        pooling = PoolingParams(2.0, suppress_robot)
        np.testing.assert_array_equal(ENCODE(PARAMS, dirty, pooling), ENCODE(PARAMS, graph, pooling))
    gradients = GRADIENTS(PARAMS, dirty, POOLING)
    jax.tree.map(np.testing.assert_array_equal, gradients[0], GRADIENTS(PARAMS, graph, POOLING)[0])
    np.testing.assert_array_equal(np.asarray(gradients[1])[4], 0.0)


def loss(params, graph, boxes, pooling):
    return jnp.sum(encoder.encode(params, replace(graph, boxes=boxes), pooling) ** 2)


@jax.jit
def GRADIENTS(params, graph, pooling):
    return jax.grad(loss, argnums=(0, 2))(params, graph, graph.boxes, pooling)


@pytest.mark.parametrize("case", ["all masked", "robot only", "all active at alpha 0"])
def test_zero_total_weight_pools_to_zero_with_finite_gradients(case):
    graph, pooling = random_graph(4), POOLING
    if case == "all masked":
        graph = replace(graph, mask=np.zeros(5, bool))
    elif case == "robot only":
        graph = replace(graph, robot=np.ones(5, bool))
    else:
        graph, pooling = replace(graph, active=np.ones(5, bool)), PoolingParams(0.0, 1.0)
    np.testing.assert_array_equal(POOL(NODES(PARAMS, graph), graph, pooling), np.zeros(6))
    assert np.isfinite(ENCODE(PARAMS, graph, pooling)).all()
    for gradient in jax.tree.leaves(GRADIENTS(PARAMS, graph, pooling)):
        assert np.isfinite(gradient).all()


def test_a_single_node_without_neighbours_is_finite():
    graph = replace(random_graph(5), mask=np.arange(5) == 2)
    assert np.isfinite(ENCODE(PARAMS, graph, POOLING)).all()
    for gradient in jax.tree.leaves(GRADIENTS(PARAMS, graph, POOLING)):
        assert np.isfinite(gradient).all()


def test_changing_alpha_or_the_robot_switch_does_not_trace_again():
    traces = []

    @jax.jit
    def counted(pooling):
        traces.append(pooling)
        return encoder.encode(PARAMS, random_graph(0), pooling)

    results = [counted(PoolingParams(alpha, robot)) for alpha in (1.0, 5.0) for robot in (0.0, 1.0)]
    assert len(traces) == 1
    assert len({float(np.asarray(result)[0]) for result in results}) == 4


def test_encoding_a_sequence_equals_encoding_its_frames():
    boxes = np.random.default_rng(0).uniform(0, 1, (4, 4, 4)).astype(np.float32)
    boxes[3] = 1e30
    mask = np.ones((4, 4), bool)
    pooling = replace(POOLING, tau=0.1)
    sequence = jax.jit(encoder.encode_sequence, static_argnums=1)(PARAMS, OBJECTS, boxes, mask, 3, pooling)
    sequence = np.asarray(sequence)
    graphs = jax.tree.map(np.asarray, jax.jit(sequence_graphs, static_argnums=0)(OBJECTS, boxes, mask, 3, 0.1))
    for t in range(3):
        close(sequence[t], ENCODE(PARAMS, jax.tree.map(lambda field, t=t: field[t], graphs), pooling))
    assert np.isfinite(sequence[3]).all()


PIXELS = PixelConfig(size=8, patch=4, widths=(3,))
TYPES = {"message_passing": MessagePassingParams, "interaction": InteractionParams, "pixels": PixelParams}


@pytest.mark.parametrize("kind", TYPES)
def test_the_kind_decides_the_parameters_type(kind):
    config = EncoderConfig(kind=kind, num_layers=1, hidden=6, embedding=5, pixels=PIXELS)
    params = INIT(jax.random.key(2), config, OBJECTS)
    assert isinstance(params, TYPES[kind])
    seen = np.zeros((8, 8, 3), np.float32) if kind == "pixels" else random_graph(0, 4)
    assert jax.eval_shape(encoder.encode, params, seen, POOLING).shape == (5,)


def test_the_parameters_type_decides_the_network():
    # One configuration, whose kind nobody asks about.
    config = EncoderConfig(num_layers=1, hidden=6, embedding=5)
    key, graph = jax.random.key(2), replace(random_graph(0, 4), mask=np.ones(4, bool))
    image = np.random.default_rng(0).uniform(size=(8, 8, 3)).astype(np.float32)
    senders = (1 - np.eye(4, dtype=np.float32)) / 3
    ours = message_passing.init(key, config, OBJECTS.num_classes)
    nodes = jax.jit(message_passing.encode_nodes)(ours, graph, senders)
    close(ENCODE(ours, graph, POOLING), jax.jit(layers.perceptron)(ours.head, POOL(nodes, graph, POOLING)))
    graphirl = interaction.init(key, config, OBJECTS.num_slots)
    nodes = jax.jit(interaction.encode_nodes)(graphirl, graph, senders)
    close(ENCODE(graphirl, graph, POOLING), POOL(nodes, graph, POOLING))
    xirl = pixels.init(key, PIXELS, 5)
    close(ENCODE(xirl, image, POOLING), jax.jit(pixels.encode)(xirl, image))


def test_graphirl_has_no_head():
    params = interaction.init(jax.random.key(2), EncoderConfig(hidden=6, embedding=5), OBJECTS.num_slots)
    pooled = np.arange(5, dtype=np.float32)
    assert encoder.head(params, pooled) is pooled
