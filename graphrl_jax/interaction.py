"""GraphIRL's encoder (Kumar et al. 2022), a baseline: an interaction network over boxes and distances.

A node's features are its box and its distances to all entities, in the order of the slots; its embedding is an affector
of what it is alone (a perceptron) and of the sum of its relations to every other node (a perceptron of both). There are
no classes and no messages beyond that one round. The plain mean over nodes is the graph's embedding.
"""

import jax
import jax.numpy as jnp

from graphrl_jax import layers
from graphrl_jax.graph import BOX_FEATURES, Graph, edge_features

InteractionParams = dict[str, layers.Perceptron]


def init(key: jax.Array, hidden: int, embedding: int, num_slots: int) -> InteractionParams:
    """Random parameters for graphs of `num_slots` nodes (N); embeddings of size `embedding` (D)."""
    own_key, relation_key, affector_key = jax.random.split(key, 3)
    features = BOX_FEATURES + num_slots
    return {
        "own": layers.init_perceptron(own_key, (features, hidden, hidden)),
        "relation": layers.init_perceptron(relation_key, (2 * features, hidden, hidden)),
        "affector": layers.init_perceptron(affector_key, (hidden, hidden, embedding)),
    }


def encode_nodes(params: InteractionParams, graph: Graph, senders: jax.Array, scale: float) -> jax.Array:
    """Embeddings of all nodes: (N, D) float32.

    Args:
      params: from `init`.
      graph: one graph, its masked slots cleared.
      senders: (N, N) float32, [receiver, sender], how much a node hears of another: 0 for itself, for masked slots and
        for a robot that is left out.
      scale: factor on boxes and distances.
    """
    heard = senders > 0
    distances = jnp.where(heard, scale * edge_features(graph.boxes)[..., 2], 0.0)
    features = jnp.concatenate([scale * (graph.boxes - 0.5), distances], axis=-1)
    slots, size = features.shape
    pairs = jnp.concatenate(
        [
            jnp.broadcast_to(features[:, None], (slots, slots, size)),
            jnp.broadcast_to(features[None, :], (slots, slots, size)),
        ],
        axis=-1,
    )
    relations = jnp.sum(jnp.where(heard[..., None], layers.perceptron(params["relation"], pairs), 0.0), axis=1)
    return layers.perceptron(params["affector"], jax.nn.relu(layers.perceptron(params["own"], features) + relations))
