"""Encoder pretraining: soft TCC plus reconstruction on demonstrations, as one jitted program.

    state = init(config, objects, key)
    state, history = run(config, hyper, data, state, num_steps)     # a chunk; as often as one likes
    state, history = train(config, hyper, data, key)                # all of it; the same numbers

`PretrainConfig` sets shapes and is static. `PretrainHyper` is traced: a sweep over it, or over seeds, is a `vmap` of
`train`, and a new value compiles nothing.
"""

from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike

from graphrl_jax import decoder, encoder, tcc
from graphrl_jax.augment import Motion, motion, rearrange
from graphrl_jax.demonstrations import Demonstrations
from graphrl_jax.encoder import EncoderConfig, Seen
from graphrl_jax.graph import Graph, ObjectTable, build_graph, update_activity
from graphrl_jax.optimizer import AdamState, adam_init, adam_update, clip_by_global_norm, warmup_cosine

Metrics = dict[str, jax.Array]


@dataclass(frozen=True)
class PretrainConfig:
    """What sets the program's shape (all static).

    | field       | meaning                                                               |
    |-------------|-----------------------------------------------------------------------|
    | steps       | optimiser steps of a whole training                                   |
    | batch_size  | demonstrations per step, drawn without replacement; all if there are fewer |
    | num_frames  | frames per demonstration, drawn without replacement, in order of time |
    | encoder     | sizes of the encoder                                                  |
    | decode_from | what the decoder sees, `node` or `pooled`                             |
    | tcc_variant | see `tcc.cycle_loss`                                                  |
    | persistent  | what has moved stays active; False is an ablation                     |

    Raises:
      ValueError: a value that is not allowed; the message names the field.
    """

    steps: int = 3000
    batch_size: int = 16
    num_frames: int = 40
    encoder: EncoderConfig = EncoderConfig()
    decode_from: decoder.Source = "node"
    tcc_variant: tcc.Variant = "regression_mse"
    persistent: bool = True

    def __post_init__(self) -> None:
        for name, least in (("steps", 1), ("batch_size", 2), ("num_frames", 2)):
            if getattr(self, name) < least:
                raise ValueError(f"PretrainConfig.{name} must be at least {least}, got {getattr(self, name)}")
        for name, known in (("decode_from", decoder.SOURCES), ("tcc_variant", tcc.VARIANTS)):
            if getattr(self, name) not in known:
                raise ValueError(f"PretrainConfig.{name} must be one of {known}, got {getattr(self, name)!r}")


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class PretrainHyper:
    """Numbers that may change without compiling: floats or () float32 arrays, all traced.

    | field                 | meaning                                                        |
    |-----------------------|----------------------------------------------------------------|
    | learning_rate         | peak of the schedule                                           |
    | final_learning_rate   | its end, half a cosine later                                   |
    | warmup                | share of the steps that warm up linearly, 0 to 1               |
    | weight_decay          | decoupled                                                      |
    | max_grad_norm         | global-norm clip                                               |
    | alpha                 | weight of active nodes in the pooling (Eq. 1)                  |
    | suppress_robot        | 1: robot's node left out of the pooling, 0: kept               |
    | tau                   | activity threshold per frame, in box diagonals                 |
    | robot_messages        | weight of the robot among a node's senders, 0 to 1             |
    | temperature           | of the TCC; the square of the embedding's unit, see below      |
    | tcc_weight            | weight of the TCC in the loss                                  |
    | reconstruction_weight | weight of box error plus class cross-entropy in the loss       |
    | rearranged            | share of demonstrations seen rearranged; 0 is the paper's way  |
    | bumped                | chance that a rearrangement moves an object never moved        |
    | bumped_before         | chance that it shows such an object as moved from the start    |
    | approach              | time the robot's way to an object takes in a rearrangement, against bringing one as far |
    | even                  | 1: an exponent makes the reward fall evenly (`reward.fit_reward`); 0: Eq. 3 |

    Without normalisation the TCC sees embeddings over the root of the temperature only. At XIRL's 1, made for the
    features of a pretrained network, a fresh encoder's embeddings are one point: the TCC sits at 1/12 on a saddle that
    some trainings never leave.
    """

    learning_rate: ArrayLike = 3e-3
    final_learning_rate: ArrayLike = 0.0
    warmup: ArrayLike = 0.05
    weight_decay: ArrayLike = 1e-5
    max_grad_norm: ArrayLike = 1.0
    alpha: ArrayLike = 2.0
    suppress_robot: ArrayLike = 1.0
    tau: ArrayLike = 0.02
    robot_messages: ArrayLike = 1.0
    temperature: ArrayLike = 0.01
    tcc_weight: ArrayLike = 1.0
    reconstruction_weight: ArrayLike = 0.1
    rearranged: ArrayLike = 1.0
    bumped: ArrayLike = 0.2
    bumped_before: ArrayLike = 0.5
    approach: ArrayLike = 0.15
    even: ArrayLike = 1.0


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class PretrainData:
    """Demonstrations on the device; fields as in `Demonstrations`, class_ids (B, N). `objects` is static.

    `frames` (B, T, H, W, 3) uint8 are there for an encoder of pictures alone.
    """

    boxes: jax.Array
    mask: jax.Array
    lengths: jax.Array
    class_ids: jax.Array
    frames: jax.Array | None
    objects: ObjectTable = field(metadata={"static": True})


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class PretrainState:
    """All that a resumed training needs.

    | field     | shape | dtype   | meaning                                        |
    |-----------|-------|---------|------------------------------------------------|
    | params    |       | float32 | {"encoder": ..., "decoder": ...}               |
    | optimizer |       |         | `AdamState`; its step counts the training's    |
    | key       | ()    | key     | source of all later randomness                 |
    """

    params: dict[str, Any]
    optimizer: AdamState
    key: jax.Array


def prepare(demonstrations: Demonstrations, picture_size: int | None = None) -> PretrainData:
    """Demonstrations as arrays on the device, with their pictures if an encoder is to see those.

    Raises:
      ValueError: fewer than two demonstrations (the TCC needs pairs), or no pictures of `picture_size` pixels.
    """
    if len(demonstrations) < 2:
        raise ValueError(f"pretraining needs at least 2 demonstrations, got {len(demonstrations)}")
    demos = demonstrations
    arrays = map(jnp.asarray, (demos.boxes, demos.mask, demos.lengths, demos.class_ids()))
    frames = None if picture_size is None else jnp.asarray(demos.pictures(picture_size))
    return PretrainData(*arrays, frames, objects=demos.objects)


def init(config: PretrainConfig, objects: ObjectTable, key: jax.Array) -> PretrainState:
    """The state before the first step, for graphs of these objects; an encoder of pictures has no decoder."""
    encoder_key, decoder_key, run_key = jax.random.split(key, 3)
    node_size = config.encoder.embedding if config.encoder.kind == "interaction" else config.encoder.hidden
    params = {"encoder": encoder.init(encoder_key, config.encoder, objects.num_classes, objects.num_slots)}
    if config.encoder.kind != "pixels":
        params["decoder"] = decoder.init(decoder_key, node_size, objects.num_classes, config.decode_from)
    return PretrainState(params, adam_init(params), run_key)


def sample_frames(key: jax.Array, length: ArrayLike, num_total: int, num_frames: int) -> tuple[jax.Array, jax.Array]:
    """Frames of one demonstration, uniformly without replacement, in order of time.

    A demonstration shorter than `num_frames` gives each of its frames once; the rest of the result is filled up.

    Args:
      key: randomness.
      length: number of real frames, 1 to num_total.
      num_total: T, the padded number of frames (static).
      num_frames: how many to draw (static).

    Returns:
      Indices (num_frames,) int32, all below `length`, and a mask (num_frames,) bool that is False where filled up.
    """
    real = jnp.arange(num_total) < length
    # The frames with the smallest of T random numbers are a uniform draw; padding sorts behind all of them.
    draw = jnp.argsort(jnp.where(real, jax.random.uniform(key, (num_total,)), 2.0))[:num_frames]
    in_order = jnp.sort(jnp.where(draw < length, draw, num_total))
    in_order = jnp.pad(in_order, (0, max(num_frames - num_total, 0)), constant_values=num_total)
    mask = in_order < length
    return jnp.where(mask, in_order, length - 1).astype(jnp.int32), mask


def _sample_batch(
    config: PretrainConfig, hyper: PretrainHyper, data: PretrainData, motions: Motion, key: jax.Array
) -> tuple[Seen, jax.Array, jax.Array]:
    """What is seen (b, F, ...), frame mask (b, F) and times (b, F) of b demonstrations with F frames each."""
    demonstration_key, frame_key = jax.random.split(key)
    num_demonstrations, num_total = data.mask.shape[:2]
    size = min(config.batch_size, num_demonstrations)
    chosen = jax.random.permutation(demonstration_key, num_demonstrations)[:size]

    def sample(demonstration: jax.Array, key: jax.Array) -> tuple[Seen, jax.Array, jax.Array]:
        length = data.lengths[demonstration]
        frame_key, show_key = jax.random.split(key)
        frames, mask = sample_frames(frame_key, length, num_total, config.num_frames)
        times = frames.astype(jnp.float32) / length.astype(jnp.float32)
        return _show(config, hyper, data, motions, demonstration, frames, show_key), mask, times

    return jax.vmap(sample)(chosen, jax.random.split(frame_key, size))


def _show(
    config: PretrainConfig,
    hyper: PretrainHyper,
    data: PretrainData,
    motions: Motion,
    demonstration: jax.Array,
    frames: jax.Array,
    key: jax.Array,
) -> Seen:
    """Graphs (F, ...) of some frames (F,) of one demonstration as training sees it, rearranged or as it was; pictures
    are always as they were, since who looks at pixels knows of no objects to rearrange.
    """
    if data.frames is not None:
        return data.frames[demonstration, frames]
    choice_key, rearrange_key = jax.random.split(key)
    moves = jax.tree.map(lambda leaf: leaf[demonstration], motions)
    choice = jax.random.bernoulli(choice_key, hyper.rearranged)

    def seen(frames: jax.Array) -> tuple[jax.Array, jax.Array]:
        times = frames / jnp.maximum(data.lengths[demonstration] - 1, 1)
        chances = (hyper.bumped, hyper.bumped_before, hyper.approach)
        rearranged = rearrange(rearrange_key, data.objects, moves, times, *chances)
        original = data.boxes[demonstration, frames], moves.active[frames]
        boxes, active = (jnp.where(choice, new, old) for new, old in zip(rearranged, original, strict=True))
        return boxes, active

    boxes, active = seen(frames)
    if not config.persistent:
        before, shown = seen(jnp.maximum(frames - 1, 0))[0], data.mask[demonstration]
        moved = jax.vmap(partial(update_activity, persistent=False), in_axes=(0, 0, 0, 0, 0, None))
        active = moved(active, before, shown[jnp.maximum(frames - 1, 0)], boxes, shown[frames], hyper.tau)
    build = jax.vmap(partial(build_graph, data.objects), in_axes=(0, 0, 0, None))
    return build(boxes, data.mask[demonstration, frames], active, data.class_ids[demonstration])


@partial(jax.jit, static_argnames=("config", "draws"))
def shown_frames(
    config: PretrainConfig, hyper: PretrainHyper, data: PretrainData, key: jax.Array, draws: int = 16
) -> Seen:
    """First, middle and last frames as training sees them, `draws` times of every demonstration.

    Returns:
      Graphs or pictures (B draws, 3, ...) for `fit_reward`.
    """
    chosen = jnp.repeat(jnp.arange(data.lengths.shape[0]), draws)
    keys = jax.random.split(key, chosen.shape[0])
    motions = _motions(hyper, data)

    def show(demonstration: jax.Array, key: jax.Array) -> Seen:
        last = data.lengths[demonstration] - 1
        return _show(config, hyper, data, motions, demonstration, jnp.stack([0 * last, last // 2, last]), key)

    return jax.vmap(show)(chosen, keys)


def _motions(hyper: PretrainHyper, data: PretrainData) -> Motion:
    """`Motion` of every demonstration, at the full frame rate: between drawn frames everything moves far."""
    return jax.vmap(motion, in_axes=(0, 0, 0, None))(data.boxes, data.mask, data.lengths, hyper.tau)


def _loss(
    params: dict[str, Any],
    config: PretrainConfig,
    hyper: PretrainHyper,
    seen: Seen,
    frame_mask: jax.Array,
    times: jax.Array,
) -> tuple[jax.Array, Metrics]:
    """Weighted sum of TCC and reconstruction over a batch (b, F), and its parts; from pictures nothing is decoded."""

    def embed_and_decode(graph: Seen) -> tuple[jax.Array, ArrayLike, ArrayLike]:
        if not isinstance(graph, Graph):
            return encoder.encode(params["encoder"], graph, 1.0, 0.0), 0.0, 0.0
        nodes = encoder.encode_nodes(params["encoder"], graph, hyper.robot_messages)
        pooled = encoder.pool(nodes, graph, hyper.alpha, hyper.suppress_robot)
        boxes, logits = decoder.apply(params["decoder"], nodes, pooled, graph, config.decode_from)
        embedding = encoder.head(params["encoder"], pooled)
        return embedding, decoder.box_loss(boxes, graph), decoder.class_loss(logits, graph)

    embeddings, box_losses, class_losses = jax.vmap(jax.vmap(embed_and_decode))(seen)
    weights = frame_mask.astype(jnp.float32) / jnp.sum(frame_mask)
    parts = {
        "tcc": tcc.tcc_loss(embeddings, frame_mask, times, hyper.temperature, config.tcc_variant),
        "box": jnp.sum(weights * box_losses),
        "class": jnp.sum(weights * class_losses),
    }
    loss = hyper.tcc_weight * parts["tcc"] + hyper.reconstruction_weight * (parts["box"] + parts["class"])
    return loss, {"loss": loss, **parts}


def optimise(
    config: PretrainConfig,
    hyper: PretrainHyper,
    state: PretrainState,
    batch: tuple[Seen, jax.Array, jax.Array],
) -> tuple[PretrainState, Metrics]:
    """One optimiser step on a batch: what is seen (b, F, ...), frame mask (b, F) and times (b, F).

    Returns:
      The state after, its key untouched, and scalars: loss, tcc, box, class, grad_norm, learning_rate.
    """
    grads, metrics = jax.grad(_loss, has_aux=True)(state.params, config, hyper, *batch)
    grads, grad_norm = clip_by_global_norm(grads, hyper.max_grad_norm)
    learning_rate = warmup_cosine(
        state.optimizer.step, config.steps, hyper.learning_rate, hyper.warmup * config.steps, hyper.final_learning_rate
    )
    params, optimizer = adam_update(
        grads, state.optimizer, state.params, learning_rate, weight_decay=hyper.weight_decay
    )
    metrics = {**metrics, "grad_norm": grad_norm, "learning_rate": learning_rate}
    return PretrainState(params, optimizer, state.key), metrics


def step(
    config: PretrainConfig, hyper: PretrainHyper, data: PretrainData, motions: Motion, state: PretrainState
) -> tuple[PretrainState, Metrics]:
    """One optimiser step on a batch drawn by the state's key.

    Args:
      config, hyper, data: see their classes.
      motions: `Motion` of every demonstration, at the full frame rate.
      state: the state before.

    Returns:
      See `optimise`; the key has moved on.
    """
    batch_key, next_key = jax.random.split(state.key)
    batch = _sample_batch(config, hyper, data, motions, batch_key)
    return optimise(config, hyper, replace(state, key=next_key), batch)


@partial(jax.jit, static_argnames=("config", "num_steps"))
def run(
    config: PretrainConfig, hyper: PretrainHyper, data: PretrainData, state: PretrainState, num_steps: int
) -> tuple[PretrainState, Metrics]:
    """`num_steps` steps in one program; chunks of any sizes give the same numbers as one run over all.

    Returns:
      The state after, and the metrics of `step`, each (num_steps,) float32.
    """
    motions = _motions(hyper, data)
    return jax.lax.scan(lambda carry, _: step(config, hyper, data, motions, carry), state, length=num_steps)


@partial(jax.jit, static_argnames="config")
def train(
    config: PretrainConfig, hyper: PretrainHyper, data: PretrainData, key: jax.Array
) -> tuple[PretrainState, Metrics]:
    """A whole training from `key`: `init`, then `config.steps` steps. Map over hyper and key with `jax.vmap`.

    Returns:
      The last state (`state.params["encoder"]` is the encoder) and the metrics of `step`, each (steps,) float32.
    """
    return run(config, hyper, data, init(config, data.objects, key), config.steps)
