"""GraphIRL's encoder against loops over its nodes."""

from dataclasses import replace

import jax
import numpy as np

from graphrl_jax.encoder import encoder, interaction, layers
from graphrl_jax.encoder.config import EncoderConfig
from graphrl_jax.encoder.interaction import InteractionParams
from graphrl_jax.encoder.pooling import PoolingParams
from graphrl_jax.graph import INPUT_SCALE
from tests.helpers.graphs import overwrite_slot, random_graph

CONFIG = EncoderConfig(hidden=8, embedding=5, kind="interaction")
PARAMS = interaction.init(jax.random.key(0), CONFIG, num_slots=5)
ENCODE = jax.jit(encoder.encode)
WITH_ROBOT = PoolingParams(alpha=1.0, suppress_robot=0.0, robot_messages=1.0)
WITHOUT_ROBOT = PoolingParams(alpha=1.0, suppress_robot=1.0, robot_messages=0.0)


def by_loops(params: InteractionParams, boxes: np.ndarray, there: list[int], pooled: list[int]) -> np.ndarray:
    """GraphIRL's embedding, node by node: what one is, what it has to do with every other, and the mean of both."""

    def features(i: int) -> np.ndarray:
        distances = np.zeros(len(boxes))
        for j in there:
            distances[j] = np.hypot(*(boxes[i, :2] - boxes[j, :2])) if j != i else 0.0
        return INPUT_SCALE * np.concatenate([boxes[i] - 0.5, distances])

    nodes = []
    for i in pooled:
        own = layers.perceptron(params.own, features(i))
        related = [layers.perceptron(params.relation, np.concatenate([features(i), features(j)]))
                   for j in there if j != i]  # fmt: skip
        nodes.append(layers.perceptron(params.affector, jax.nn.relu(own + sum(related))))
    return np.mean(nodes, axis=0)


def test_the_interaction_network_is_graphirls():
    graph = random_graph(3)
    there = np.flatnonzero(graph.mask).tolist()
    found = ENCODE(PARAMS, graph, WITH_ROBOT)
    np.testing.assert_allclose(found, by_loops(PARAMS, np.asarray(graph.boxes), there, there), rtol=2e-4, atol=2e-4)


def test_without_the_robot_graphirl_does_not_know_of_it():
    graph = random_graph(3)
    moved = replace(graph, boxes=np.where(graph.robot[:, None], np.float32(0.9), graph.boxes))
    left_out = [ENCODE(PARAMS, g, WITHOUT_ROBOT) for g in (graph, moved)]
    with_it = [ENCODE(PARAMS, g, WITH_ROBOT) for g in (graph, moved)]
    np.testing.assert_allclose(*left_out, atol=1e-6)
    assert not np.allclose(*with_it, atol=1e-3)


def test_masked_slots_take_part_in_nothing():
    graph = random_graph(3)
    found = [ENCODE(PARAMS, g, WITH_ROBOT) for g in (graph, overwrite_slot(graph, 4, np.nan))]
    np.testing.assert_allclose(*found, atol=1e-6)
