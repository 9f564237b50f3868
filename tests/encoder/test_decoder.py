"""The decoder's two inputs, its masked losses."""

from dataclasses import replace

import jax
import numpy as np
import pytest

from graphrl_jax.encoder import decoder
from graphrl_jax.encoder.config import DECODER_INPUTS
from tests.helpers.graphs import overwrite_slot, pad, random_graph

INIT = jax.jit(decoder.init, static_argnums=(1, 2, 3))
APPLY = jax.jit(decoder.apply, static_argnums=4)
BOX_LOSS = jax.jit(decoder.box_loss)
CLASS_LOSS = jax.jit(decoder.class_loss)
PARAMS = {source: INIT(jax.random.key(0), 6, 3, source) for source in DECODER_INPUTS}
RANDOM = np.random.default_rng(0)
NODES = RANDOM.normal(size=(5, 6)).astype(np.float32)
POOLED = RANDOM.normal(size=6).astype(np.float32)


@pytest.mark.parametrize("source", DECODER_INPUTS)
def test_shapes(source):
    boxes, logits = APPLY(PARAMS[source], NODES, POOLED, random_graph(0), source)
    assert boxes.shape == (5, 4) and logits.shape == (5, 3)


def test_node_source_reads_each_node_alone():
    boxes, _ = APPLY(PARAMS["node"], NODES, POOLED, random_graph(0), "node")
    changed = NODES.copy()
    changed[2] += 1
    after, _ = APPLY(PARAMS["node"], changed, POOLED + 1, random_graph(0), "node")
    same = np.all(np.asarray(boxes) == np.asarray(after), axis=1)
    np.testing.assert_array_equal(same, [True, True, False, True, True])


def test_pooled_source_reads_the_pooled_embedding_and_asks_by_class():
    graph = replace(random_graph(0), classes=np.eye(3, dtype=np.float32)[[0, 1, 2, 1, 0]])
    boxes, _ = APPLY(PARAMS["pooled"], NODES, POOLED, graph, "pooled")
    again, _ = APPLY(PARAMS["pooled"], NODES + 1, POOLED, graph, "pooled")
    other, _ = APPLY(PARAMS["pooled"], NODES, POOLED + 1, graph, "pooled")
    boxes, other = np.asarray(boxes), np.asarray(other)
    np.testing.assert_array_equal(again, boxes)
    assert not np.allclose(other, boxes)
    np.testing.assert_allclose(boxes[1], boxes[3])
    assert not np.allclose(boxes[0], boxes[1])


def test_box_loss_by_hand():
    graph = random_graph(0)  # slot 4 is masked
    boxes = graph.boxes + np.array([[1], [0], [0], [2], [100]], np.float32)
    np.testing.assert_allclose(BOX_LOSS(boxes, graph), (1 + 4) / 4, rtol=1e-5)
    assert float(BOX_LOSS(graph.boxes, graph)) == 0.0


def test_class_loss_by_hand():
    graph = replace(random_graph(0), mask=np.arange(5) < 2, classes=np.eye(3, dtype=np.float32)[[0, 1, 2, 1, 0]])
    logits = np.zeros((5, 3), np.float32)
    np.testing.assert_allclose(CLASS_LOSS(logits, graph), np.log(3), rtol=1e-5)
    logits[0, 0] = logits[1, 1] = 50.0
    assert float(CLASS_LOSS(logits, graph)) < 1e-6


@pytest.mark.parametrize("garbage", [1e30, np.nan])
def test_masked_slots_reach_neither_losses_nor_gradients(garbage):
    graph = random_graph(1)
    dirty = overwrite_slot(graph, 4, garbage)
    for loss, outputs in ((BOX_LOSS, 4), (CLASS_LOSS, 3)):
        decoded = RANDOM.normal(size=(5, outputs)).astype(np.float32)
        np.testing.assert_array_equal(loss(decoded, dirty), loss(decoded, graph))
        gradient = np.asarray(jax.jit(jax.grad(loss))(decoded, dirty))
        assert np.isfinite(gradient).all()
        np.testing.assert_array_equal(gradient[4], 0.0)


def test_an_empty_graph_costs_nothing():
    graph = replace(random_graph(0), mask=np.zeros(5, bool))
    assert float(BOX_LOSS(np.ones((5, 4), np.float32), graph)) == 0.0
    assert float(CLASS_LOSS(np.ones((5, 3), np.float32), graph)) == 0.0


def test_padding_changes_no_loss():
    graph = random_graph(1)
    wider = pad(graph, 8)
    for loss, outputs in ((BOX_LOSS, 4), (CLASS_LOSS, 3)):
        decoded = RANDOM.normal(size=(8, outputs)).astype(np.float32)
        np.testing.assert_allclose(loss(decoded, wider), loss(decoded[:5], graph), rtol=1e-6)
