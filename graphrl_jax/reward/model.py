"""The learned reward (Eq. 3): minus the scaled distance between the embeddings of a graph and of the goal.

TCC orders embeddings in time but does not fix their distances. At half-time of a demonstration the distance to the goal
may have fallen to a half or to a third, and with it the reward left for the second half. An exponent, fitted at
half-time only, makes the reward rise evenly.
"""

import math
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from graphrl_jax.demonstrations import Demonstrations
from graphrl_jax.encoder import encoder, pixels
from graphrl_jax.encoder.config import ActivityRule, EncoderConfig
from graphrl_jax.encoder.encoder import EncoderParams, Seen, encode, encode_sequence
from graphrl_jax.encoder.pooling import PoolingParams
from graphrl_jax.graph import ObjectTable, safe_norm
from graphrl_jax.reward import hub
from graphrl_jax.reward.card import MODEL, Card, read_card, write_card
from graphrl_jax.storage import load_tensors, save_tensors

FARTHEST = 2.0
"""Largest scaled distance; the first frames are at 1. What is thrown out of the image must not outweigh the rest."""
MOST_EVENED = 3.0
"""Largest fitted exponent; the smallest is its inverse."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class RewardModel:
    """A frozen encoder with its goal and scale. It is a pytree argument, so a new encoder needs no recompilation.

    | field      | shape | dtype   | meaning                                                       |
    |------------|-------|---------|---------------------------------------------------------------|
    | params     |       | float32 | encoder parameters                                            |
    | goal       | (D,)  | float32 | g, the goal embedding                                         |
    | kappa      | ()    | float32 | scale of the distance; 1 in the plain Eq. 3                   |
    | exponent   | ()    | float32 | exponent of the scaled distance; 1 in Eq. 3                   |
    | pooling    |       | float32 | `PoolingParams`                                               |
    | image_size |       | int     | static: edge of the input images in pixels; None for graphs   |
    | card       |       |         | static: `Card`; None while it is trained                      |
    """

    params: EncoderParams
    goal: jax.Array
    kappa: jax.Array
    exponent: jax.Array
    pooling: PoolingParams
    image_size: int | None = field(default=None, metadata={"static": True})
    card: Card | None = field(default=None, metadata={"static": True})

    @classmethod
    def load(cls, folder: str | Path, revision: str | None = None) -> "RewardModel":
        """The reward model in a folder: one that `save` wrote, or that of a run; or a model of the Hugging Face Hub.

        Args:
          folder: the folder; or, where there is no such folder, owner/name of a model on the hub.
          revision: branch, tag or commit of a model on the hub.

        Raises:
          StorageError: the folder holds none, or a damaged one; the message names the file and the field.
          ValueError: a folder has no revisions; see also `hub.download`.
        """
        folder = Path(folder)
        if hub.on_hub(folder):
            folder = hub.download(folder, revision)
        elif revision is not None:
            raise ValueError(f"the revision {revision!r} is asked for, but {folder} names no model of the hub")
        card = read_card(folder)
        return replace(load_parameters(folder, card.encoder, card.activity, card.objects), card=card)

    def save(self, folder: str | Path, numbers: Mapping[str, Any] | None = None) -> None:
        """Writes the model into a folder, which may be moved: config.json, model.safetensors, README.md.

        Args:
          folder: where; missing folders are created.
          numbers: measures of the model for its README.md.

        Raises:
          ValueError: the model has no card.
          StorageError: a parameter is not finite.
        """
        if self.card is None:
            raise ValueError("a reward model without card cannot be saved, because nobody could tell what it takes")
        save_parameters(Path(folder), self)
        write_card(Path(folder), self.card, numbers or {})

    def push_to_hub(
        self,
        name: str,
        numbers: Mapping[str, Any] | None = None,
        private: bool | None = None,
        revision: str | None = None,
    ) -> str:
        """Writes the model to the Hugging Face Hub, as `save` writes it to a folder; returns its address.

        Args:
          name: owner/name.
          numbers: measures of the model for its README.md.
          private: whether a new repository is private; default: the owner's setting.
          revision: branch that gets the files; it must exist. Default: the main branch.

        Raises:
          ValueError: the model has no card; see also `hub.upload`.
          StorageError: a parameter is not finite.
        """
        with tempfile.TemporaryDirectory() as folder:
            self.save(folder, numbers)
            return hub.upload(Path(folder), name, private, revision)

    def rewards(self, boxes: ArrayLike, mask: ArrayLike) -> jax.Array:
        """The reward of every frame of a recording: (T,) float32; see `embed_recording`."""
        return self.value(safe_norm(self.embed_recording(boxes, mask) - self.goal[None]))

    def embed_recording(self, boxes: ArrayLike, mask: ArrayLike) -> jax.Array:
        """phi of every frame of a recording: (T, D) float32.

        Args:
          boxes: (T, N, 4) float32, in the order of the card's objects, at its frame rate.
          mask: (T, N) bool, False where the object was not seen.

        Raises:
          ValueError: the model has no card, takes images, or has another number of objects.
        """
        card = self.card
        if card is None or self.image_size is not None:
            raise ValueError("scores of boxes need a reward model of graphs with a card")
        boxes, mask = jnp.asarray(boxes, jnp.float32), jnp.asarray(mask, bool)
        slots = card.objects.num_slots
        if boxes.ndim != 3 or boxes.shape[1:] != (slots, 4) or mask.shape != boxes.shape[:2]:
            raise ValueError(
                f"rewards takes boxes (T, {slots}, 4) and mask (T, {slots}), got {boxes.shape} and {mask.shape}"
            )
        return encode_sequence(self.params, card.objects, boxes, mask, boxes.shape[0], self.pooling)

    def embed(self, seen: Seen) -> jax.Array:
        """phi(G) of one graph, or of one image: (D,)."""
        return encode(self.params, seen, self.pooling)

    def distance(self, seen: Seen) -> jax.Array:
        """||phi(G) - g||_2 of one graph, a scalar, without kappa."""
        return safe_norm(self.embed(seen) - self.goal)

    def apply(self, seen: Seen) -> jax.Array:
        """Eq. 3 with scale, bound and exponent: the reward of one graph, a scalar; see `value`."""
        return self.value(self.distance(seen))

    def value(self, distance: jax.Array) -> jax.Array:
        """The reward -min(kappa distance, FARTHEST)^exponent at distances of any shape.

        Its gradient at distance 0 is 0, not infinite.
        """
        scaled = jnp.minimum(self.kappa * distance, FARTHEST)
        return -jnp.where(scaled > 0, jnp.where(scaled > 0, scaled, 1.0) ** self.exponent, 0.0)


def save_parameters(folder: Path, model: RewardModel) -> None:
    """Writes the parameters of a model, without its card, into a folder.

    Raises:
      StorageError: a parameter is not finite.
    """
    save_tensors(folder / MODEL, replace(model, card=None))


def load_parameters(folder: Path, config: EncoderConfig, activity: ActivityRule, objects: ObjectTable) -> RewardModel:
    """The model, without card, whose parameters are in a folder.

    Raises:
      StorageError: there are none, or they do not match an encoder of these sizes.
    """
    return load_tensors(folder / MODEL, shapes(config, activity, objects))


def shapes(config: EncoderConfig, activity: ActivityRule, objects: ObjectTable) -> RewardModel:
    """Shapes and dtypes of a model, without card, whose encoder has these sizes."""

    def model() -> RewardModel:
        zero = jnp.zeros((), jnp.float32)
        params = encoder.init(jax.random.key(0), config, objects)
        pooling = PoolingParams(zero, zero, zero, zero, activity)
        return RewardModel(params, jnp.zeros(config.embedding, jnp.float32), zero, zero, pooling, config.image_size)

    return jax.eval_shape(model)


def fit_reward(
    params: EncoderParams,
    demonstrations: Demonstrations,
    pooling: PoolingParams,
    shown: Seen | None = None,
    even: ArrayLike = 0.0,
    exponent: ArrayLike = 1.0,
    image_size: int | None = None,
) -> RewardModel:
    """Fits goal, scale and exponent to successful demonstrations.

    The goal g is the mean of phi over the last frames of `shown`; kappa is 1 / mean over demonstrations of
    ||phi(first frame) - g||, so that demonstrations start near reward -1.

    Args:
      params: encoder parameters.
      demonstrations: successful ones only.
      pooling: see `PoolingParams`.
      shown: first, middle and last frames of demonstrations as encoder inputs (M, 3, ...), such as
        `trainer.shown_frames`; default: those of `demonstrations`.
      even: 1 fits the exponent so that the reward at the middle frames is half of that at the first frames (1 if the
        middle frames are not closer to the goal than the first); 0 takes `exponent`.
      exponent: the exponent where `even` is 0; 1 is Eq. 3.
      image_size: edge of the input images in pixels; None for graphs.

    Raises:
      ValueError: a demonstration is a failure, or the first frames coincide with the goal.
    """
    failures = int(np.sum(~demonstrations.success))
    if failures:
        raise ValueError(
            f"the goal is fitted to successes only, but {failures} of {len(demonstrations)} demonstrations are "
            "failures; pass demonstrations.successes()"
        )
    embeddings = embed_demonstrations(params, demonstrations, pooling, image_size)
    if shown is None:
        last = demonstrations.lengths - 1
        frames = np.stack([np.zeros_like(last), last // 2, last], axis=1)
        seen = jnp.take_along_axis(embeddings, frames[..., None], axis=1)
    else:
        seen = _embed_all(params, shown, pooling)
    goal = jnp.mean(seen[:, 2], axis=0)
    start_distance = jnp.mean(safe_norm(embeddings[:, 0] - goal[None]))
    if not start_distance > 0:
        raise ValueError(
            f"the first frames of the demonstrations must differ from the goal, got a mean distance of {start_distance}"
        )
    evened = _halving_exponent(safe_norm(seen - goal[None, None]))
    scalars = (1 / start_distance, exponent + even * (evened - exponent), pooling)
    return RewardModel(params, goal, *jax.tree.map(partial(jnp.asarray, dtype=jnp.float32), scalars), image_size)


def _halving_exponent(distances: jax.Array) -> float:
    """The exponent p with (middle / first)^p = 1/2 for the mean middle and first distances; distances (M, 3)."""
    first, middle = (float(distance) for distance in jnp.mean(distances[:, :2], axis=0))
    if not 0 < middle < first:  # the embeddings have no order in time
        return 1.0
    return min(max(math.log(2) / math.log(first / middle), 1 / MOST_EVENED), MOST_EVENED)


def embed_demonstrations(
    params: EncoderParams,
    demonstrations: Demonstrations,
    pooling: PoolingParams,
    image_size: int | None = None,
) -> jax.Array:
    """phi of every frame: (B, T, D) float32; rows from a demonstration's length on are finite but have no meaning.

    Raises:
      DemonstrationError: `image_size` is given, and the demonstrations have no images of that size.
    """
    demos = demonstrations
    if image_size is not None:
        return jnp.stack([_embed_images(params, sequence) for sequence in demos.images(image_size)])
    return _embed_batch(demos.objects, params, demos.boxes, demos.mask, demos.lengths, pooling, demos.class_ids())


def demonstration_embeddings(model: RewardModel, demonstrations: Demonstrations) -> jax.Array:
    """phi of every frame under a reward model; see `embed_demonstrations`."""
    return embed_demonstrations(model.params, demonstrations, model.pooling, model.image_size)


def demonstration_rewards(model: RewardModel, demonstrations: Demonstrations) -> jax.Array:
    """Reward of every frame: (B, T) float32; values from a demonstration's length on have no meaning."""
    return model.value(safe_norm(demonstration_embeddings(model, demonstrations) - model.goal[None, None]))


@jax.jit
def _embed_all(params: EncoderParams, seen: Seen, pooling: PoolingParams) -> jax.Array:
    axes = (None, 0, None)
    return jax.vmap(jax.vmap(encode, axes), axes)(params, seen, pooling)


@jax.jit
def _embed_images(params: EncoderParams, frames: jax.Array) -> jax.Array:
    return jax.vmap(pixels.encode, (None, 0))(params, frames)


@partial(jax.jit, static_argnames="objects")
def _embed_batch(
    objects: ObjectTable,
    params: EncoderParams,
    boxes: jax.Array,
    mask: jax.Array,
    lengths: jax.Array,
    pooling: PoolingParams,
    class_ids: jax.Array,
) -> jax.Array:
    batched = jax.vmap(encode_sequence, in_axes=(None, None, 0, 0, 0, None, 0))
    return batched(params, objects, boxes, mask, lengths, pooling, class_ids)
