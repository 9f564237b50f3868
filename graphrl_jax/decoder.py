"""The decoder: every object's box and class back from the embedding, so that the encoder cannot forget where they are.

The paper leaves open what the decoder sees. `node` gives it each node's own embedding z_i, as the paper's figure
suggests. `pooled` gives it the pooled embedding z_g, the same for all nodes, and the node's class as the question; this
makes the pooled embedding keep the objects apart. Two objects of one class cannot be told apart by that question.
"""

from typing import Literal, get_args

import jax
import jax.numpy as jnp

from graphrl_jax import layers
from graphrl_jax.graph import BOX_FEATURES, Graph, clear_masked_slots

Source = Literal["node", "pooled"]
SOURCES: tuple[str, ...] = get_args(Source)


def init(key: jax.Array, hidden: int, num_classes: int, decode_from: Source) -> layers.Perceptron:
    """Random parameters for embeddings of size `hidden` (H) and `num_classes` classes (C)."""
    inputs = hidden + (num_classes if decode_from == "pooled" else 0)
    return layers.init_perceptron(key, (inputs, hidden, BOX_FEATURES + num_classes))


def apply(
    params: layers.Perceptron, nodes: jax.Array, pooled: jax.Array, graph: Graph, decode_from: Source
) -> tuple[jax.Array, jax.Array]:
    """Box and class of every slot.

    Args:
      params: from `init` with the same `decode_from`.
      nodes: (N, H) node embeddings; read by `node` only.
      pooled: (H,) pooled embedding; read by `pooled` only.
      graph: the graph they belong to; `pooled` reads its classes.
      decode_from: `node` or `pooled`.

    Returns:
      Boxes (N, 4) and class logits (N, C), float32; rows of masked slots mean nothing.
    """
    if decode_from == "pooled":
        shared = jnp.broadcast_to(pooled, (graph.mask.shape[0], pooled.shape[0]))
        nodes = jnp.concatenate([shared, graph.classes], axis=-1)
    decoded = layers.perceptron(params, nodes)
    return decoded[:, :BOX_FEATURES], decoded[:, BOX_FEATURES:]


def box_loss(boxes: jax.Array, graph: Graph) -> jax.Array:
    """Mean squared error of the four box values over unmasked nodes: (N, 4) -> scalar, zero for an empty graph."""
    error = jnp.where(graph.mask[:, None], boxes - graph.boxes, 0.0)
    return _node_mean(jnp.mean(error**2, axis=-1), graph.mask)


def class_loss(logits: jax.Array, graph: Graph) -> jax.Array:
    """Mean cross-entropy over unmasked nodes: (N, C) -> scalar, zero for an empty graph."""
    classes = clear_masked_slots(graph).classes
    return _node_mean(-jnp.sum(classes * jax.nn.log_softmax(logits, axis=-1), axis=-1), graph.mask)


def _node_mean(values: jax.Array, mask: jax.Array) -> jax.Array:
    """Mean of (N,) values over unmasked nodes."""
    return jnp.sum(jnp.where(mask, values, 0.0)) / jnp.maximum(jnp.sum(mask.astype(jnp.float32)), 1.0)
