"""GraphIRL's encoder (Kumar et al. 2022), a baseline: an interaction network over boxes and distances.

The features of a node are its box and its distances to all nodes, in slot order. One perceptron maps these features,
another maps every pair of nodes to a relation. The affector maps the sum of a node's own term and its relations to the
node's embedding. There are no classes and no further rounds. The graph's embedding is the plain mean over nodes.
"""

from dataclasses import dataclass

import jax
import jax.numpy as jnp

from graphrl_jax.encoder import layers
from graphrl_jax.encoder.config import EncoderConfig
from graphrl_jax.graph import BOX_FEATURES, INPUT_SCALE, Graph, edge_features


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class InteractionParams:
    """Three perceptrons, all float32; a node has F = 4 + N features.

    | field    | meaning                                       |
    |----------|-----------------------------------------------|
    | affector | own term plus relations to embedding, H to D  |
    | own      | node to own term, F to H                      |
    | relation | pair of nodes to relation, 2 F to H           |
    """

    affector: layers.Perceptron
    own: layers.Perceptron
    relation: layers.Perceptron


def init(key: jax.Array, config: EncoderConfig, num_slots: int) -> InteractionParams:
    """Random parameters for graphs of `num_slots` nodes (N)."""
    own_key, relation_key, affector_key = jax.random.split(key, 3)
    features, hidden = BOX_FEATURES + num_slots, config.hidden
    return InteractionParams(
        affector=layers.init_perceptron(affector_key, (hidden, hidden, config.embedding)),
        own=layers.init_perceptron(own_key, (features, hidden, hidden)),
        relation=layers.init_perceptron(relation_key, (2 * features, hidden, hidden)),
    )


def encode_nodes(params: InteractionParams, graph: Graph, senders: jax.Array) -> jax.Array:
    """Embeddings of all nodes, from boxes and distances times `INPUT_SCALE`: (N, D) float32.

    Args:
      params: from `init`.
      graph: one graph, its masked slots cleared.
      senders: (N, N) float32, [receiver, sender], weight of each sender: 0 for the node itself, for masked slots and
        for a robot that is left out.
    """
    heard = senders > 0
    distances = jnp.where(heard, INPUT_SCALE * edge_features(graph.boxes)[..., 2], 0.0)
    features = jnp.concatenate([INPUT_SCALE * (graph.boxes - 0.5), distances], axis=-1)
    slots, size = features.shape
    pairs = jnp.concatenate(
        [
            jnp.broadcast_to(features[:, None], (slots, slots, size)),
            jnp.broadcast_to(features[None, :], (slots, slots, size)),
        ],
        axis=-1,
    )
    relations = jnp.sum(jnp.where(heard[..., None], layers.perceptron(params.relation, pairs), 0.0), axis=1)
    return layers.perceptron(params.affector, jax.nn.relu(layers.perceptron(params.own, features) + relations))
