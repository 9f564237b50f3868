"""Encoder pretraining: soft TCC plus reconstruction on demonstrations, as one jitted program.

    state = init(config, objects, key)
    state, metrics = run(config, hyper, data, state, num_steps)     # one chunk; repeat as needed

`PretrainConfig` sets shapes and is static. `PretrainHyper` is traced: a sweep over it, or over seeds, is a `vmap` of
`run`, and a new value needs no recompilation.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike

from graphrl_jax.demonstrations import Demonstrations
from graphrl_jax.encoder import decoder, encoder
from graphrl_jax.encoder.encoder import Seen
from graphrl_jax.encoder.pixels import PixelParams
from graphrl_jax.encoder.pooling import PoolingParams
from graphrl_jax.graph import ActivityState, ObjectTable, build_graph, update_activity
from graphrl_jax.optimizer import AdamState, adam_init, adam_update, clip_by_global_norm, warmup_cosine
from graphrl_jax.pretrain import tcc
from graphrl_jax.pretrain.augment import Chances, Motion, motion, rearrange
from graphrl_jax.pretrain.config import PretrainConfig, PretrainHyper

Metrics = dict[str, jax.Array]
DrawBoxes = Callable[[jax.Array, jax.Array, jax.Array, jax.Array], jax.Array]
"""Draws boxes (N, 4), mask (N,), class_ids (N,) and turns (N,) as an image (H, W, 3) uint8; see `Task.draw_boxes`."""


jax.tree_util.register_dataclass(PretrainHyper)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class PretrainData:
    """Demonstrations on the device; fields as in `Demonstrations`, class_ids (B, N). `objects` and `draw` are static.

    `frames` (B, T, H, W, 3) uint8 are present only for an encoder of images, and `draw` only if it learns from
    rearrangements, too.
    """

    boxes: jax.Array
    mask: jax.Array
    lengths: jax.Array
    class_ids: jax.Array
    frames: jax.Array | None
    objects: ObjectTable = field(metadata={"static": True})
    draw: DrawBoxes | None = field(default=None, metadata={"static": True})


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class PretrainState:
    """Everything that a resumed training needs.

    | field     | shape | dtype   | meaning                                        |
    |-----------|-------|---------|------------------------------------------------|
    | params    |       | float32 | {"encoder": ..., "decoder": ...}               |
    | optimizer |       |         | `AdamState`; its `step` counts training steps  |
    | key       | ()    | key     | source of all later randomness                 |
    """

    params: dict[str, Any]
    optimizer: AdamState
    key: jax.Array


def pooling_params(config: PretrainConfig, hyper: PretrainHyper) -> PoolingParams:
    """The pooling parameters of a pretraining configuration."""
    return PoolingParams(hyper.alpha, hyper.suppress_robot, hyper.robot_messages, hyper.tau, config.activity)


def prepare(
    demonstrations: Demonstrations, image_size: int | None = None, draw: DrawBoxes | None = None
) -> PretrainData:
    """Demonstrations as arrays on the device, with their images if `image_size` is given.

    With `draw`, rearrangements of them can be shown as images, too.

    Raises:
      ValueError: fewer than two demonstrations (the TCC needs pairs), or no images of `image_size` pixels.
    """
    if len(demonstrations) < 2:
        raise ValueError(f"pretraining needs at least 2 demonstrations, got {len(demonstrations)}")
    demos = demonstrations
    arrays = map(jnp.asarray, (demos.boxes, demos.mask, demos.lengths, demos.class_ids()))
    frames = None if image_size is None else jnp.asarray(demos.images(image_size))
    return PretrainData(*arrays, frames, objects=demos.objects, draw=draw)


def init(config: PretrainConfig, objects: ObjectTable, key: jax.Array) -> PretrainState:
    """The state before the first step, for graphs of these objects; an encoder of images has no decoder."""
    encoder_key, decoder_key, run_key = jax.random.split(key, 3)
    node_size = config.encoder.embedding if config.encoder.kind == "interaction" else config.encoder.hidden
    params: dict[str, Any] = {"encoder": encoder.init(encoder_key, config.encoder, objects)}
    if config.encoder.image_size is None:
        params["decoder"] = decoder.init(decoder_key, node_size, objects.num_classes, config.decode_from)
    return PretrainState(params, adam_init(params), run_key)


def sample_frames(key: jax.Array, length: ArrayLike, num_total: int, num_frames: int) -> tuple[jax.Array, jax.Array]:
    """Frames of one demonstration, drawn uniformly without replacement, in order of time.

    A demonstration shorter than `num_frames` gives each of its frames once; the rest of the result is padding.

    Args:
      key: randomness.
      length: number of real frames, 1 to num_total.
      num_total: T, the padded number of frames (static).
      num_frames: how many to draw (static).

    Returns:
      Indices (num_frames,) int32, all below `length`, and a mask (num_frames,) bool that is False for padding.
    """
    real = jnp.arange(num_total) < length
    # The frames with the smallest of T random numbers are a uniform draw; padding sorts last.
    draw = jnp.argsort(jnp.where(real, jax.random.uniform(key, (num_total,)), 2.0))[:num_frames]
    in_order = jnp.sort(jnp.where(draw < length, draw, num_total))
    in_order = jnp.pad(in_order, (0, max(num_frames - num_total, 0)), constant_values=num_total)
    mask = in_order < length
    return jnp.where(mask, in_order, length - 1).astype(jnp.int32), mask


def _sample_batch(
    config: PretrainConfig, hyper: PretrainHyper, data: PretrainData, motions: Motion, key: jax.Array
) -> tuple[Seen, jax.Array, jax.Array]:
    """Encoder inputs (b, F, ...), frame mask (b, F) and times (b, F) of b demonstrations with F frames each."""
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
    """Encoder inputs (F, ...) of the frames (F,) of one demonstration in training, rearranged or original. Images are
    always original if nothing draws others.
    """
    if data.frames is not None and data.draw is None:
        return data.frames[demonstration, frames]
    choice_key, rearrange_key, turn_key = jax.random.split(key, 3)
    moves = jax.tree.map(lambda leaf: leaf[demonstration], motions)
    choice = jax.random.bernoulli(choice_key, hyper.rearranged)
    # By the other rules, an object is active from its first motion on.
    tau = hyper.tau if config.activity == "displacement" else 0.0
    chances = Chances(hyper.bumped, hyper.bumped_before, hyper.approach, hyper.in_order, tau)

    def rearranged(frames: jax.Array) -> tuple[jax.Array, jax.Array]:
        times = frames / jnp.maximum(data.lengths[demonstration] - 1, 1)
        return rearrange(rearrange_key, data.objects, moves, times, chances)

    if data.frames is not None:
        drawn = _draw(data, demonstration, rearranged(frames)[0], turn_key)
        return jnp.where(choice, drawn, data.frames[demonstration, frames])

    def seen(frames: jax.Array) -> tuple[jax.Array, jax.Array]:
        original = data.boxes[demonstration, frames], moves.active[frames]
        boxes, active = (jnp.where(choice, new, old) for new, old in zip(rearranged(frames), original, strict=True))
        return boxes, active

    boxes, active = seen(frames)
    if config.activity == "momentary":
        before, shown = jnp.maximum(frames - 1, 0), data.mask[demonstration]
        state = ActivityState(active, seen(before)[0], shown[before])
        update = jax.vmap(partial(update_activity, rule=config.activity), in_axes=(0, 0, 0, None))
        active = update(state, boxes, shown[frames], hyper.tau).active
    build = jax.vmap(partial(build_graph, data.objects), in_axes=(0, 0, 0, None))
    return build(boxes, data.mask[demonstration, frames], active, data.class_ids[demonstration])


def _draw(data: PretrainData, demonstration: jax.Array, boxes: jax.Array, key: jax.Array) -> jax.Array:
    """Images (F, H, W, 3) uint8 of boxes (F, N, 4), with every object that is ever seen, turned at random."""
    assert data.draw is not None
    there = data.mask[demonstration].any(axis=0)
    turns = jax.random.uniform(key, there.shape, minval=-math.pi, maxval=math.pi)
    return jax.vmap(data.draw, in_axes=(0, None, None, None))(boxes, there, data.class_ids[demonstration], turns)


@partial(jax.jit, static_argnames=("config", "draws"))
def shown_frames(
    config: PretrainConfig, hyper: PretrainHyper, data: PretrainData, key: jax.Array, draws: int = 16
) -> Seen:
    """First, middle and last frames of every demonstration, as in training, `draws` times each.

    Returns:
      Graphs or images (B draws, 3, ...) for `fit_reward`.
    """
    chosen = jnp.repeat(jnp.arange(data.lengths.shape[0]), draws)
    keys = jax.random.split(key, chosen.shape[0])
    motions = _motions(config, hyper, data)

    def show(demonstration: jax.Array, key: jax.Array) -> Seen:
        last = data.lengths[demonstration] - 1
        return _show(config, hyper, data, motions, demonstration, jnp.stack([0 * last, last // 2, last]), key)

    return jax.vmap(show)(chosen, keys)


def _motions(config: PretrainConfig, hyper: PretrainHyper, data: PretrainData) -> Motion:
    """`Motion` of every demonstration at the full frame rate, because objects move far between drawn frames."""
    one = partial(motion, rule=config.activity)
    return jax.vmap(one, in_axes=(0, 0, 0, None))(data.boxes, data.mask, data.lengths, hyper.tau)


def _loss(
    params: dict[str, Any],
    config: PretrainConfig,
    hyper: PretrainHyper,
    seen: Seen,
    frame_mask: jax.Array,
    times: jax.Array,
) -> tuple[jax.Array, Metrics]:
    """Weighted sum of TCC and reconstruction over a batch (b, F), and its terms; images have no reconstruction."""

    pooling = pooling_params(config, hyper)

    def embed_and_decode(graph: Seen) -> tuple[jax.Array, ArrayLike, ArrayLike]:
        if isinstance(params["encoder"], PixelParams):
            return encoder.encode(params["encoder"], graph, pooling), 0.0, 0.0
        embeddings = encoder.embed(params["encoder"], graph, pooling)
        boxes, logits = decoder.apply(params["decoder"], embeddings.nodes, embeddings.pooled, graph, config.decode_from)
        return embeddings.graph, decoder.box_loss(boxes, graph), decoder.class_loss(logits, graph)

    embeddings, box_losses, class_losses = jax.vmap(jax.vmap(embed_and_decode))(seen)
    weights = frame_mask.astype(jnp.float32) / jnp.sum(frame_mask)
    parts = {
        "tcc": tcc.tcc_loss(embeddings, frame_mask, times, hyper.temperature, config.tcc_loss),
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
    """One optimiser step on a batch: encoder inputs (b, F, ...), frame mask (b, F) and times (b, F).

    Returns:
      The next state, with the same key, and scalars: loss, tcc, box, class, grad_norm, skipped_steps (1 if the gradient
      was not finite and changed nothing), learning_rate.
    """
    grads, metrics = jax.grad(_loss, has_aux=True)(state.params, config, hyper, *batch)
    grads, grad_norm = clip_by_global_norm(grads, hyper.max_grad_norm)
    learning_rate = warmup_cosine(
        state.optimizer.step, config.steps, hyper.learning_rate, hyper.warmup * config.steps, hyper.final_learning_rate
    )
    params, optimizer = adam_update(
        grads, state.optimizer, state.params, learning_rate, weight_decay=hyper.weight_decay
    )
    skipped = 1.0 - jnp.isfinite(grad_norm)
    metrics = {**metrics, "grad_norm": grad_norm, "skipped_steps": skipped, "learning_rate": learning_rate}
    return PretrainState(params, optimizer, state.key), metrics


def step(
    config: PretrainConfig, hyper: PretrainHyper, data: PretrainData, motions: Motion, state: PretrainState
) -> tuple[PretrainState, Metrics]:
    """One optimiser step on a batch drawn with the state's key.

    Args:
      config, hyper, data: see their classes.
      motions: `Motion` of every demonstration, at the full frame rate.
      state: the current state.

    Returns:
      See `optimise`; the next state has a new key.
    """
    batch_key, next_key = jax.random.split(state.key)
    batch = _sample_batch(config, hyper, data, motions, batch_key)
    return optimise(config, hyper, replace(state, key=next_key), batch)


@partial(jax.jit, static_argnames=("config", "num_steps"))
def run(
    config: PretrainConfig, hyper: PretrainHyper, data: PretrainData, state: PretrainState, num_steps: int
) -> tuple[PretrainState, Metrics]:
    """`num_steps` steps in one program; chunks of any sizes give the same result as a single run.

    Returns:
      The final state, and the metrics of `step`, each (num_steps,) float32.
    """
    motions = _motions(config, hyper, data)
    return jax.lax.scan(lambda carry, _: step(config, hyper, data, motions, carry), state, length=num_steps)
