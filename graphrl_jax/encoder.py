"""The graph encoder: message passing, weighted pooling (Eq. 1-2), head. One graph in, one embedding out.

The encoder runs inside every step of every environment, so its message function is factored. A message from j to i is
a two-layer perceptron of (h_i, h_j, e_ij), averaged over the senders j. Its first layer is split into node-wise
products that are added up per edge, an offset being a difference of two nodes' centres; its second layer is linear and
so commutes with the average, and then merges with the first layer of the node update. What is left to do per edge is a
sum, with the distance's share, and a ReLU; the result is exactly the same.
"""

from dataclasses import dataclass
from typing import Any, Literal, get_args

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike

from graphrl_jax import interaction, layers, pixels
from graphrl_jax.graph import BOX_FEATURES, Graph, ObjectTable, clear_masked_slots, edge_features, sequence_graphs
from graphrl_jax.pixels import PixelConfig

Kind = Literal["message_passing", "interaction", "pixels"]
KINDS: tuple[str, ...] = get_args(Kind)
EDGE_FEATURES = 3
# Places and offsets differ by about a fifth of the image; at unit size the network learns the edge of a region instead
# of a bowl around it.
INPUT_SCALE = 5.0

EncoderParams = dict[str, Any]
Seen = Graph | jax.Array
"""What an encoder looks at: a graph, or a picture (H, W, 3) where its kind is `pixels`."""


@dataclass(frozen=True)
class EncoderConfig:
    """Sizes of the encoder (all static).

    | field       | meaning                                                          |
    |-------------|------------------------------------------------------------------|
    | num_layers  | rounds of message passing; 0 embeds every object by itself       |
    | hidden      | H, size of node embeddings, messages and the head's hidden layers |
    | embedding   | D, size of the graph embedding                                   |
    | head_layers | hidden layers of the head; 0 makes it linear                     |
    | kind        | `interaction` is GraphIRL's encoder (`interaction.py`): one round, no head |
    |             | `pixels` is XIRL's (`pixels.py`): pictures, none of these sizes but D |
    | edges       | offsets and distances on the edges; False is an ablation         |
    | pixels      | sizes of XIRL's network                                          |

    Raises:
      ValueError: a size is too small or the kind unknown; the message names it.
    """

    num_layers: int = 2
    hidden: int = 32
    embedding: int = 32
    head_layers: int = 1
    kind: Kind = "message_passing"
    edges: bool = True
    pixels: PixelConfig = PixelConfig()

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ValueError(f"EncoderConfig.kind must be one of {KINDS}, got {self.kind!r}")
        for field, least in (("num_layers", 0), ("hidden", 1), ("embedding", 1), ("head_layers", 0)):
            if getattr(self, field) < least:
                raise ValueError(f"EncoderConfig.{field} must be at least {least}, got {getattr(self, field)}")

    @property
    def picture_size(self) -> int | None:
        """Pixels along the edge of the pictures it looks at; None if it looks at graphs."""
        return self.pixels.size if self.kind == "pixels" else None


def init(key: jax.Array, config: EncoderConfig, num_classes: int, num_slots: int | None = None) -> EncoderParams:
    """Random parameters for graphs with `num_classes` classes (C) and any number of nodes.

    The kind `interaction` knows no classes, but has to be told the number of nodes, `num_slots`.
    """
    if config.kind == "interaction":
        if num_slots is None:
            raise ValueError("an encoder of kind 'interaction' needs num_slots, got None")
        return interaction.init(key, config.hidden, config.embedding, num_slots)
    if config.kind == "pixels":
        return pixels.init(key, config.pixels, config.embedding)
    input_key, head_key, *layer_keys = jax.random.split(key, 2 + config.num_layers)
    head_sizes = [config.hidden] * (1 + config.head_layers) + [config.embedding]
    return {
        "input": layers.init_perceptron(input_key, (num_classes + BOX_FEATURES, config.hidden)),
        "layers": tuple(_init_message_layer(layer_key, config) for layer_key in layer_keys),
        "head": layers.init_perceptron(head_key, head_sizes),
    }


def _init_message_layer(key: jax.Array, config: EncoderConfig) -> dict[str, jax.Array]:
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


def encode_nodes(params: EncoderParams, graph: Graph, robot_messages: ArrayLike = 1.0) -> jax.Array:
    """Node embeddings z_i after message passing, from boxes and offsets times `INPUT_SCALE`: (N, H) float32.

    Args:
      params: encoder parameters.
      graph: one graph.
      robot_messages: weight of the robot among a node's senders, 0 to 1. At 1 other nodes know of the robot even where
        the pooling leaves it out; at 0 they do not.

    Returns:
      z_i; rows of masked slots are finite and mean nothing.
    """
    graph = clear_masked_slots(graph)
    weights = _sender_weights(graph, robot_messages)
    if "relation" in params:
        return interaction.encode_nodes(params, graph, weights, INPUT_SCALE)
    centres, distances = INPUT_SCALE * graph.boxes[:, :2], INPUT_SCALE * edge_features(graph.boxes)[..., 2]
    features = jnp.concatenate([graph.classes, INPUT_SCALE * (graph.boxes - 0.5)], axis=-1)
    nodes = jax.nn.relu(layers.perceptron(params["input"], features))
    for layer in params["layers"]:
        nodes = _pass_messages(layer, nodes, centres, distances, weights)
    return nodes


def _sender_weights(graph: Graph, robot_messages: ArrayLike) -> jax.Array:
    """(N, N) weights [receiver, sender] of the mean over all other unmasked nodes; a node alone receives zero."""
    others = graph.mask[None, :] & ~jnp.eye(graph.mask.shape[0], dtype=bool)
    senders = jnp.where(others, jnp.where(graph.robot, robot_messages, 1.0), 0.0)
    return senders / jnp.maximum(jnp.sum(senders, axis=1, keepdims=True), 1.0)


def _pass_messages(
    layer: dict[str, jax.Array], nodes: jax.Array, centres: jax.Array, distances: jax.Array, weights: jax.Array
) -> jax.Array:
    """One round: (N, H) nodes, (N, 2) centres, (N, N) distances, (N, N) sender weights -> (N, H) nodes."""
    to_receiver = nodes @ layer["receiver"] + layer["message_bias"]
    from_sender = nodes @ layer["sender"]
    if "edge" not in layer:
        pairs = to_receiver[:, None, :] + from_sender[None, :, :]
    else:
        places = centres @ layer["edge"][:2]
        pairs = (to_receiver - places)[:, None, :] + (from_sender + places)[None, :, :]
        pairs += distances[:, :, None] * layer["edge"][2]
    # Measured on CPU: the matrix product over senders is twice as fast, forward and backward, as the masked sum it
    # stands for.
    hidden = jax.nn.relu(pairs)
    messages = jnp.einsum("ij,ijh->ih", weights, hidden)
    update = jax.nn.relu(nodes @ layer["own"] + messages @ layer["messages"] + layer["update_bias"])
    return nodes + update @ layer["output"]


def pooling_weights(graph: Graph, alpha: ArrayLike, suppress_robot: ArrayLike) -> jax.Array:
    """Eq. 1: w_i = (1 + (alpha - 1) active_i) (1 - suppress_robot robot_i), zero in masked slots.

    Args:
      graph: one graph.
      alpha: weight of an active node against an inactive one's 1, at least 0.
      suppress_robot: 1 leaves the robot's node out ("w/o robot"), 0 keeps it ("w/ robot").

    Returns:
      (N,) float32.
    """
    emphasis = 1.0 + (jnp.asarray(alpha, jnp.float32) - 1.0) * graph.active.astype(jnp.float32)
    kept = 1.0 - jnp.asarray(suppress_robot, jnp.float32) * graph.robot.astype(jnp.float32)
    return jnp.where(graph.mask, emphasis * kept, 0.0)


def pool(nodes: jax.Array, graph: Graph, alpha: ArrayLike, suppress_robot: ArrayLike) -> jax.Array:
    """Eq. 2: z_g = sum_i w_i z_i / sum_i w_i over the unmasked nodes. A graph of zero total weight pools to zero.

    Args:
      nodes: (N, H) float32 node embeddings.
      graph, alpha, suppress_robot: see `pooling_weights`.

    Returns:
      (H,) float32.
    """
    weights = pooling_weights(graph, alpha, suppress_robot)
    total = jnp.sum(weights)
    # The inner `where` keeps the division, and with it the gradient, finite where the outer value is zero anyway.
    shares = jnp.where(total > 0, weights / jnp.where(total > 0, total, 1.0), 0.0)
    return shares @ jnp.where(graph.mask[:, None], nodes, 0.0)


def head(params: EncoderParams, pooled: jax.Array) -> jax.Array:
    """phi(G) from the pooled embedding: (H,) -> (D,) float32; GraphIRL's is the pooled embedding itself."""
    return layers.perceptron(params["head"], pooled) if "head" in params else pooled


def encode(
    params: EncoderParams,
    seen: Seen,
    alpha: ArrayLike,
    suppress_robot: ArrayLike,
    robot_messages: ArrayLike = 1.0,
) -> jax.Array:
    """phi(G), the embedding of one graph: (D,) float32. Arguments as in `pooling_weights` and `encode_nodes`.

    XIRL's encoder gets a picture instead, and has no use for the weights.
    """
    if not isinstance(seen, Graph):
        return pixels.encode(params, seen)
    return head(params, pool(encode_nodes(params, seen, robot_messages), seen, alpha, suppress_robot))


def encode_sequence(
    params: EncoderParams,
    objects: ObjectTable,
    boxes: jax.Array,
    mask: jax.Array,
    length: ArrayLike,
    alpha: ArrayLike,
    suppress_robot: ArrayLike,
    tau: ArrayLike,
    robot_messages: ArrayLike = 1.0,
    class_ids: jax.Array | None = None,
    persistent: bool = True,
) -> jax.Array:
    """phi of every frame of one padded demonstration, activity included.

    Args:
      boxes, mask, length, tau, class_ids, persistent: see `graph.sequence_graphs`.
      params, alpha, suppress_robot, robot_messages: see `encode`.

    Returns:
      (T, D) float32; rows from `length` on are finite and mean nothing.
    """
    graphs = sequence_graphs(objects, boxes, mask, length, tau, class_ids, persistent)
    return jax.vmap(encode, in_axes=(None, 0, None, None, None))(params, graphs, alpha, suppress_robot, robot_messages)
