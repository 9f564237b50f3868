"""Message passing, factored, against messages computed edge by edge."""

from dataclasses import replace

import jax
import numpy as np
import pytest

from graphrl_jax.encoder import encoder
from graphrl_jax.encoder.config import EncoderConfig
from graphrl_jax.encoder.message_passing import MessagePassingParams
from graphrl_jax.encoder.pooling import PoolingParams
from tests.helpers.graphs import OBJECTS, random_graph

CONFIG = EncoderConfig(num_layers=2, hidden=6, embedding=5)
INIT = jax.jit(encoder.init, static_argnums=(1, 2))
PARAMS = INIT(jax.random.key(0), CONFIG, OBJECTS)
ENCODE = jax.jit(encoder.encode)
NODES = jax.jit(encoder.encode_nodes)
POOLING = PoolingParams(alpha=2.0, suppress_robot=1.0)


def close(actual, expected):
    np.testing.assert_allclose(actual, expected, rtol=1e-4, atol=1e-5)


def relu(values):
    return np.maximum(values, 0)


def test_node_embeddings_equal_messages_computed_edge_by_edge():
    graph = random_graph(1)
    params = jax.tree.map(np.asarray, PARAMS)
    boxes, classes = np.asarray(graph.boxes), np.asarray(graph.classes)
    present = np.flatnonzero(graph.mask)
    linear = params.input[0]
    scaled = 5.0 * (boxes - 0.5)
    nodes = {i: relu(np.concatenate([classes[i], scaled[i]]) @ linear["weight"] + linear["bias"]) for i in present}
    for layer in params.layers:
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


def test_an_encoder_without_edges_is_one_whose_edges_weigh_nothing():
    bare = INIT(jax.random.key(0), replace(CONFIG, edges=False), OBJECTS)
    assert all("edge" not in layer for layer in bare.layers)
    weightless = replace(PARAMS, layers=tuple({**layer, "edge": 0 * layer["edge"]} for layer in PARAMS.layers))
    graph = random_graph(4)
    expected = ENCODE(weightless, graph, POOLING)
    np.testing.assert_allclose(ENCODE(bare, graph, POOLING), expected, atol=1e-6)
    assert not np.allclose(ENCODE(PARAMS, graph, POOLING), expected, atol=1e-3)


@pytest.mark.parametrize("layers, head_layers", [(0, 0), (1, 2)])
def test_sizes_follow_the_configuration(layers, head_layers):
    config = EncoderConfig(num_layers=layers, hidden=4, embedding=3, head_layers=head_layers)
    params = jax.eval_shape(lambda: encoder.init(jax.random.key(1), config, OBJECTS))
    assert isinstance(params, MessagePassingParams)
    assert len(params.layers) == layers and len(params.head) == head_layers + 1
    assert jax.eval_shape(encoder.encode, params, random_graph(0), PoolingParams(1.0, 1.0)).shape == (3,)
