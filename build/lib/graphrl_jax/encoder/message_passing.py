"""Our encoder: message passing over the graph, then a head on the pooled embedding.

The encoder runs in every step of every environment, so the message function is factored. A message from j to i is a
two-layer perceptron of (h_i, h_j, e_ij), averaged over the senders j. The first layer splits into node-wise products
that are added per edge, because an offset is a difference of two centres. The second layer is linear, so it commutes
with the average and merges with the first layer of the node update. Per edge there remain a sum, with the term of the
distance, and a ReLU. The result is exactly the same.
"""

from dataclasses import dataclass

import jax
import jax.numpy as jnp

from graphrl_jax.encoder import layers
from graphrl_jax.encoder.config import EncoderConfig
from graphrl_jax.graph import BOX_FEATURES, EDGE_FEATURES, INPUT_SCALE, Graph, edge_features

MessageLayer = dict[str, jax.Array]


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class MessagePassingParams:
    """Parameters, all float32: the head, the perceptron of each node's own features, and a dict per round.

    | field  | meaning                                               |
    |--------|-------------------------------------------------------|
    | head   | perceptron, H to D                                    |
    | input  | perceptron, C + 4 to H                                |
    | layers | weights and biases of each round of messages, by name |
    """

    head: layers.Perceptron
    input: layers.Perceptron
    layers: tuple[MessageLayer, ...]


def init(key: jax.Array, config: EncoderConfig, num_classes: int) -> MessagePassingParams:
    """Random parameters for graphs with `num_classes` classes (C) and any number of nodes."""
    input_key, head_key, *layer_keys = jax.random.split(key, 2 + config.num_layers)
    head_sizes = [config.hidden] * (1 + config.head_layers) + [config.embedding]
    return MessagePassingParams(
        head=layers.init_perceptron(head_key, head_sizes),
        input=layers.init_perceptron(input_key, (num_classes + BOX_FEATURES, config.hidden)),
        layers=tuple(_init_layer(layer_key, config) for layer_key in layer_keys),
    )


def _init_layer(key: jax.Array, config: EncoderConfig) -> MessageLayer:
    hidden = config.hidden
    receiver, sender, edge, own, messages, output = jax.random.split(key, 6)
    return {
        "receiver": layers.init_weight(receiver, hidden, hidden),
        "sender": layers.init_weight(sender, hidden, hidden),
        **({"edge": layers.init_weight(edge, EDGE_FEATURES, hidden)} if config.edges else {}),
        "message_bias": jnp.zeros((hidden,), jnp.float32),
        "own": layers.init_weight(own, hidden, hidden),
        "messages": layers.init_weight(messages, hidden, hidden),
        "update_bias": jnp.zeros((hidden,), jnp.float32),
        "output": layers.init_weight(output, hidden, hidden),
    }


def encode_nodes(params: MessagePassingParams, graph: Graph, senders: jax.Array) -> jax.Array:
    """Node embeddings z_i after message passing, from boxes and offsets times `INPUT_SCALE`: (N, H) float32.

    Args:
      params: from `init`.
      graph: one graph, its masked slots cleared.
      senders: (N, N) float32, [receiver, sender], weights of the mean over a node's senders.
    """
    centres, distances = INPUT_SCALE * graph.boxes[:, :2], INPUT_SCALE * edge_features(graph.boxes)[..., 2]
    features = jnp.concatenate([graph.classes, INPUT_SCALE * (graph.boxes - 0.5)], axis=-1)
    nodes = jax.nn.relu(layers.perceptron(params.input, features))
    for layer in params.layers:
        nodes = _pass_messages(layer, nodes, centres, distances, senders)
    return nodes


def _pass_messages(
    layer: MessageLayer, nodes: jax.Array, centres: jax.Array, distances: jax.Array, senders: jax.Array
) -> jax.Array:
    """One round: (N, H) nodes, (N, 2) centres, (N, N) distances, (N, N) sender weights -> (N, H) nodes."""
    to_receiver = layers.add_bias(nodes @ layer["receiver"], layer["message_bias"])
    from_sender = nodes @ layer["sender"]
    if "edge" not in layer:
        pairs = to_receiver[:, None, :] + from_sender[None, :, :]
    else:
        places = centres @ layer["edge"][:2]
        pairs = (to_receiver - places)[:, None, :] + (from_sender + places)[None, :, :]
        pairs += distances[:, :, None] * layer["edge"][None, None, 2]
    # Measured on CPU: the matrix product over senders is twice as fast, forward and backward, as the equivalent
    # masked sum.
    hidden = jax.nn.relu(pairs)
    messages = jnp.einsum("ij,ijh->ih", senders, hidden)
    update = layers.add_bias(nodes @ layer["own"] + messages @ layer["messages"], layer["update_bias"])
    update = jax.nn.relu(update)
    return nodes + update @ layer["output"]
