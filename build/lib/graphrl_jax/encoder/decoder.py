"""The decoder: reconstructs the box and class of every object, so that embeddings keep the positions of objects.

The paper does not specify the decoder's input. With `node` it is each node's own embedding z_i, as the paper's figure
suggests. With `pooled` it is the pooled embedding z_g, the same for all nodes, and the node's class as a query; the
pooled embedding then has to keep the objects apart. The query does not distinguish two objects of one class.
"""

import jax
import jax.numpy as jnp

from graphrl_jax.encoder import layers
from graphrl_jax.encoder.config import DecoderInput
from graphrl_jax.graph import BOX_FEATURES, Graph, clear_masked_slots


def init(key: jax.Array, hidden: int, num_classes: int, decode_from: DecoderInput) -> layers.Perceptron:
    """Random parameters for embeddings of size `hidden` (H) and `num_classes` classes (C)."""
    inputs = hidden + (num_classes if decode_from == "pooled" else 0)
    return layers.init_perceptron(key, (inputs, hidden, BOX_FEATURES + num_classes))


def apply(
    params: layers.Perceptron, nodes: jax.Array, pooled: jax.Array, graph: Graph, decode_from: DecoderInput
) -> tuple[jax.Array, jax.Array]:
    """Box and class of every slot.

    Args:
      params: from `init` with the same `decode_from`.
      nodes: (N, H) node embeddings; used by `node` only.
      pooled: (H,) pooled embedding; used by `pooled` only.
      graph: the graph of these embeddings; `pooled` uses its classes.
      decode_from: `node` or `pooled`.

    Returns:
      Boxes (N, 4) and class logits (N, C), float32; rows of masked slots have no meaning.
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
