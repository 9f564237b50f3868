"""Weighted pooling (Eq. 1-2): nodes that have moved weigh more, and the robot's node can be left out."""

from dataclasses import dataclass, field

import jax
import jax.numpy as jnp

from graphrl_jax.encoder.config import ACTIVITY_RULES, ActivityRule
from graphrl_jax.graph import Graph


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class PoolingParams:
    """Parameters of activity, messages and pooling; a new float needs no recompilation.

    | field          | shape | dtype   | meaning                                                                  |
    |----------------|-------|---------|--------------------------------------------------------------------------|
    | alpha          | ()    | float32 | weight of an active node; an inactive one has 1; at least 0 (Eq. 1)      |
    | suppress_robot | ()    | float32 | 1 leaves the robot's node out ("w/o robot"), 0 keeps it ("w/ robot")     |
    | robot_messages | ()    | float32 | weight of the robot among a node's senders, 0 to 1                       |
    | tau            | ()    | float32 | activity threshold, in box diagonals                                     |
    | activity       |       | str     | static: rule by which an object becomes active (`graph.update_activity`) |

    Raises:
      ValueError: the rule is unknown.
    """

    alpha: jax.Array | float = 2.0
    suppress_robot: jax.Array | float = 1.0
    robot_messages: jax.Array | float = 1.0
    tau: jax.Array | float = 0.15
    activity: ActivityRule = field(default="displacement", metadata={"static": True})

    def __post_init__(self) -> None:
        if self.activity not in ACTIVITY_RULES:
            raise ValueError(f"PoolingParams.activity is {self.activity!r}; allowed: {', '.join(ACTIVITY_RULES)}")


def weights(graph: Graph, pooling: PoolingParams) -> jax.Array:
    """Eq. 1: w_i = (1 + (alpha - 1) active_i) (1 - suppress_robot robot_i), zero in masked slots: (N,) float32."""
    emphasis = 1.0 + (jnp.asarray(pooling.alpha, jnp.float32) - 1.0) * graph.active.astype(jnp.float32)
    kept = 1.0 - jnp.asarray(pooling.suppress_robot, jnp.float32) * graph.robot.astype(jnp.float32)
    return jnp.where(graph.mask, emphasis * kept, 0.0)


def pool(nodes: jax.Array, graph: Graph, pooling: PoolingParams) -> jax.Array:
    """Eq. 2: z_g = sum_i w_i z_i / sum_i w_i over the unmasked nodes. A graph of zero total weight pools to zero.

    Args:
      nodes: (N, H) float32 node embeddings z_i.
      graph: the graph of these nodes.
      pooling: see `PoolingParams`.

    Returns:
      z_g, (H,) float32.
    """
    node_weights = weights(graph, pooling)
    total = jnp.sum(node_weights)
    # The inner `where` keeps the division and its gradient finite where the outer `where` selects zero.
    shares = jnp.where(total > 0, node_weights / jnp.where(total > 0, total, 1.0), 0.0)
    return shares @ jnp.where(graph.mask[:, None], nodes, 0.0)
