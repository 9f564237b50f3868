"""The learned reward (Eq. 3): minus the scaled distance of a graph's embedding to the goal's, as one frozen value.

TCC orders embeddings in time but leaves open how far apart they lie: half-way through a demonstration the distance may
have fallen to a half or to a third, and with it what the second half of the task pays. An exponent, fitted to half-time
alone, makes the reward fall evenly.
"""

import math
from dataclasses import dataclass, field
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from graphrl_jax import pixels
from graphrl_jax.demonstrations import Demonstrations
from graphrl_jax.encoder import EncoderParams, Seen, encode, encode_sequence
from graphrl_jax.graph import ObjectTable, safe_norm

MOST_EVENED = 3.0
"""Fitted exponents lie between this and its inverse."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class RewardModel:
    """A frozen encoder, its goal and its scale. A pytree: pass it as an argument, and a new encoder compiles nothing.

    | field          | shape | dtype   | meaning                                                  |
    |----------------|-------|---------|----------------------------------------------------------|
    | params         |       | float32 | encoder parameters                                       |
    | goal           | (D,)  | float32 | g, the goal embedding                                    |
    | kappa          | ()    | float32 | scale; 1 gives the bare Eq. 3                            |
    | exponent       | ()    | float32 | of the scaled distance; 1 gives Eq. 3                    |
    | alpha          | ()    | float32 | weight of active nodes (Eq. 1)                           |
    | suppress_robot | ()    | float32 | 1: robot's node left out of the pooling, 0: kept         |
    | tau            | ()    | float32 | activity threshold per frame, in box diagonals           |
    | robot_messages | ()    | float32 | weight of the robot among a node's senders               |
    | persistent     |       | bool    | static: what has moved stays active                      |
    | picture_size   |       | int     | static: pixels along the edge of what it looks at; None: graphs |
    """

    params: EncoderParams
    goal: jax.Array
    kappa: jax.Array
    exponent: jax.Array
    alpha: jax.Array
    suppress_robot: jax.Array
    tau: jax.Array
    robot_messages: jax.Array
    persistent: bool = field(default=True, metadata={"static": True})
    picture_size: int | None = field(default=None, metadata={"static": True})

    def embed(self, seen: Seen) -> jax.Array:
        """phi(G) of one graph, or of one picture: (D,)."""
        return encode(self.params, seen, self.alpha, self.suppress_robot, self.robot_messages)

    def distance(self, seen: Seen) -> jax.Array:
        """||phi(G) - g||_2 of one graph, a scalar, without kappa."""
        return safe_norm(self.embed(seen) - self.goal)

    def apply(self, seen: Seen) -> jax.Array:
        """Eq. 3 with XIRL's scale, evened: the reward -(kappa ||phi(G) - g||_2)^exponent of one graph, a scalar."""
        return self.value(self.distance(seen))

    def value(self, distance: jax.Array) -> jax.Array:
        """The reward at a distance; any shape. Its gradient at distance 0 is 0, not infinite."""
        scaled = self.kappa * distance
        return -jnp.where(scaled > 0, jnp.where(scaled > 0, scaled, 1.0) ** self.exponent, 0.0)


def fit_reward(
    params: EncoderParams,
    demonstrations: Demonstrations,
    alpha: ArrayLike,
    suppress_robot: ArrayLike,
    tau: ArrayLike,
    shown: Seen | None = None,
    even: ArrayLike = 0.0,
    robot_messages: ArrayLike = 1.0,
    persistent: bool = True,
    picture_size: int | None = None,
) -> RewardModel:
    """Goal, scale and exponent from successful demonstrations.

    The goal g is the mean of phi over the last frames shown; kappa is 1 / mean over demonstrations of
    ||phi(first frame) - g||, so that demonstrations start near reward -1.

    Args:
      params: encoder parameters.
      demonstrations: successful ones only.
      alpha, suppress_robot: pooling, see `encoder.pooling_weights`.
      tau: activity threshold, see `graph.update_activity`.
      shown: first, middle and last frames of demonstrations, graphs (M, 3, ...), such as `pretrain.shown_frames`; by
        default those of `demonstrations`.
      even: 1 fits the exponent so that at the middle frames the reward is half of that at the first ones; 0 leaves it
        at 1, which is Eq. 3. So does an encoder whose middle frames are no nearer to the goal.
      robot_messages: see `encoder.encode_nodes`.
      persistent: see `graph.update_activity`.
      picture_size: of the pictures that the encoder looks at, instead of graphs.

    Raises:
      ValueError: a demonstration is a failure, or the first frames coincide with the goal.
    """
    failures = int(np.sum(~demonstrations.success))
    if failures:
        raise ValueError(
            f"the goal is fitted to successes only, but {failures} of {len(demonstrations)} demonstrations are "
            "failures; pass demonstrations.successes()"
        )
    weights = (alpha, suppress_robot, tau, robot_messages)
    embeddings = embed_demonstrations(params, demonstrations, *weights, persistent, picture_size)
    if shown is None:
        last = demonstrations.lengths - 1
        frames = np.stack([np.zeros_like(last), last // 2, last], axis=1)
        seen = jnp.take_along_axis(embeddings, frames[..., None], axis=1)
    else:
        seen = _embed_all(params, shown, alpha, suppress_robot, robot_messages)
    goal = jnp.mean(seen[:, 2], axis=0)
    start_distance = jnp.mean(safe_norm(embeddings[:, 0] - goal))
    if not start_distance > 0:
        raise ValueError(
            f"the first frames of the demonstrations must differ from the goal, got a mean distance of {start_distance}"
        )
    exponent = 1.0 + even * (_halving_exponent(safe_norm(seen - goal)) - 1.0)
    scalars = (1 / start_distance, exponent, alpha, suppress_robot, tau, robot_messages)
    return RewardModel(params, goal, *(jnp.asarray(value, jnp.float32) for value in scalars), persistent, picture_size)


def _halving_exponent(distances: jax.Array) -> float:
    """The exponent that halves the mean distance from the first to the middle frames; distances (M, 3)."""
    first, middle = (float(distance) for distance in jnp.mean(distances[:, :2], axis=0))
    if not 0 < middle < first:  # an encoder without any order in time
        return 1.0
    return min(max(math.log(2) / math.log(first / middle), 1 / MOST_EVENED), MOST_EVENED)


def embed_demonstrations(
    params: EncoderParams,
    demonstrations: Demonstrations,
    alpha: ArrayLike,
    suppress_robot: ArrayLike,
    tau: ArrayLike,
    robot_messages: ArrayLike = 1.0,
    persistent: bool = True,
    picture_size: int | None = None,
) -> jax.Array:
    """phi of every frame: (B, T, D) float32; rows behind a demonstration's length are finite and mean nothing.

    Raises:
      DemonstrationError: pictures are wanted, and the demonstrations have none of that size.
    """
    demos = demonstrations
    if picture_size is not None:
        frames = demos.pictures(picture_size)
        return jnp.stack([_embed_pictures(params, sequence) for sequence in frames])
    weights = (alpha, suppress_robot, tau, robot_messages)
    data = (demos.boxes, demos.mask, demos.lengths, demos.class_ids())
    return _embed_batch(demos.objects, persistent, params, *data, *weights)


def demonstration_embeddings(model: RewardModel, demonstrations: Demonstrations) -> jax.Array:
    """phi of every frame as a reward model sees it; see `embed_demonstrations`."""
    weights = (model.alpha, model.suppress_robot, model.tau, model.robot_messages)
    return embed_demonstrations(model.params, demonstrations, *weights, model.persistent, model.picture_size)


def demonstration_rewards(model: RewardModel, demonstrations: Demonstrations) -> jax.Array:
    """Reward of every frame: (B, T) float32; what lies behind a demonstration's length means nothing."""
    return model.value(safe_norm(demonstration_embeddings(model, demonstrations) - model.goal))


@jax.jit
def _embed_all(
    params: EncoderParams, seen: Seen, alpha: ArrayLike, suppress_robot: ArrayLike, robot_messages: ArrayLike
) -> jax.Array:
    axes = (None, 0, None, None, None)
    return jax.vmap(jax.vmap(encode, axes), axes)(params, seen, alpha, suppress_robot, robot_messages)


@jax.jit
def _embed_pictures(params: EncoderParams, frames: jax.Array) -> jax.Array:
    return jax.vmap(pixels.encode, (None, 0))(params, frames)


@partial(jax.jit, static_argnames=("objects", "persistent"))
def _embed_batch(
    objects: ObjectTable,
    persistent: bool,
    params: EncoderParams,
    boxes: jax.Array,
    mask: jax.Array,
    lengths: jax.Array,
    class_ids: jax.Array,
    alpha: ArrayLike,
    suppress_robot: ArrayLike,
    tau: ArrayLike,
    robot_messages: ArrayLike,
) -> jax.Array:
    embed = partial(encode_sequence, persistent=persistent)
    batched = jax.vmap(embed, in_axes=(None, None, 0, 0, 0, None, None, None, None, 0))
    return batched(params, objects, boxes, mask, lengths, alpha, suppress_robot, tau, robot_messages, class_ids)
