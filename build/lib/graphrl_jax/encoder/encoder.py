"""phi(G): nodes are embedded, pooled and passed through a head. The type of the parameters selects the network."""

from dataclasses import dataclass
from functools import partial

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike

from graphrl_jax.encoder import interaction, layers, message_passing, pixels
from graphrl_jax.encoder.config import EncoderConfig
from graphrl_jax.encoder.interaction import InteractionParams
from graphrl_jax.encoder.message_passing import MessagePassingParams
from graphrl_jax.encoder.pixels import PixelParams
from graphrl_jax.encoder.pooling import PoolingParams, pool
from graphrl_jax.graph import Graph, ObjectTable, clear_masked_slots, sequence_graphs

GraphParams = MessagePassingParams | InteractionParams
EncoderParams = GraphParams | PixelParams
Seen = Graph | jax.Array
"""Input of an encoder: a graph, or an image (H, W, 3) for `PixelParams`."""


def init(key: jax.Array, config: EncoderConfig, objects: ObjectTable) -> EncoderParams:
    """Random parameters of an encoder for graphs of these objects."""
    match config.kind:
        case "message_passing":
            return message_passing.init(key, config, objects.num_classes)
        case "interaction":
            return interaction.init(key, config, objects.num_slots)
        case "pixels":
            return pixels.init(key, config.pixels, config.embedding)


def encode_nodes(params: GraphParams, graph: Graph, robot_messages: ArrayLike = 1.0) -> jax.Array:
    """Node embeddings z_i: (N, H) float32.

    Args:
      params: parameters of an encoder of graphs.
      graph: one graph.
      robot_messages: weight of the robot among a node's senders, 0 to 1. At 1, other nodes receive messages from the
        robot even if the pooling leaves it out; at 0, they receive none.

    Returns:
      z_i; rows of masked slots are finite but have no meaning.
    """
    graph = clear_masked_slots(graph)
    senders = _sender_weights(graph, robot_messages)
    if isinstance(params, InteractionParams):
        return interaction.encode_nodes(params, graph, senders)
    return message_passing.encode_nodes(params, graph, senders)


def _sender_weights(graph: Graph, robot_messages: ArrayLike) -> jax.Array:
    """(N, N) weights [receiver, sender] of the mean over all other unmasked nodes; a single node receives zero."""
    others = graph.mask[None, :] & ~jnp.eye(graph.mask.shape[0], dtype=bool)
    senders = jnp.where(others, jnp.where(graph.robot, robot_messages, 1.0), 0.0)
    return senders / jnp.maximum(jnp.sum(senders, axis=1, keepdims=True), 1.0)


def head(params: GraphParams, pooled: jax.Array) -> jax.Array:
    """phi(G) from the pooled embedding: (H,) -> (D,) float32; for GraphIRL it is the pooled embedding itself."""
    return pooled if isinstance(params, InteractionParams) else layers.perceptron(params.head, pooled)


# Accelerators round the factors of matrix products by default; a reward should be the same number on every device.
_full_precision = partial(jax.default_matmul_precision, "highest")


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class GraphEmbeddings:
    """Node, pooled and graph embeddings of one graph.

    | field  | shape  | dtype   | meaning                          |
    |--------|--------|---------|----------------------------------|
    | nodes  | (N, H) | float32 | z_i, after message passing       |
    | pooled | (H,)   | float32 | z_g, after pooling (Eq. 2)       |
    | graph  | (D,)   | float32 | phi(G), after the head           |
    """

    nodes: jax.Array
    pooled: jax.Array
    graph: jax.Array


def embed(params: GraphParams, graph: Graph, pooling: PoolingParams) -> GraphEmbeddings:
    """Node embeddings, pooled embedding and phi(G) of one graph."""
    with _full_precision():
        nodes = encode_nodes(params, graph, pooling.robot_messages)
        pooled = pool(nodes, graph, pooling)
        return GraphEmbeddings(nodes, pooled, head(params, pooled))


def encode(params: EncoderParams, seen: Seen, pooling: PoolingParams) -> jax.Array:
    """phi(G), the embedding of one graph: (D,) float32. XIRL's encoder takes an image and has no pooling."""
    if isinstance(params, PixelParams):
        with _full_precision():
            return pixels.encode(params, seen)
    return embed(params, seen, pooling).graph


def encode_sequence(
    params: GraphParams,
    objects: ObjectTable,
    boxes: jax.Array,
    mask: jax.Array,
    length: ArrayLike,
    pooling: PoolingParams,
    class_ids: jax.Array | None = None,
) -> jax.Array:
    """phi of every frame of one padded demonstration, with activity.

    Args:
      params: parameters of an encoder of graphs.
      objects, boxes, mask, length, class_ids: see `graph.sequence_graphs`.
      pooling: `tau` and `activity` define activity.

    Returns:
      (T, D) float32; rows from `length` on are finite but have no meaning.
    """
    graphs = sequence_graphs(objects, boxes, mask, length, pooling.tau, class_ids, pooling.activity)
    return jax.vmap(encode, in_axes=(None, 0, None))(params, graphs, pooling)
