"""Pretraining on a toy: it learns, resumes exactly, sweeps by vmap and compiles once."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from graphrl_jax.encoder.config import EncoderConfig, PixelConfig
from graphrl_jax.encoder.pooling import PoolingParams
from graphrl_jax.graph import ObjectTable
from graphrl_jax.pretrain import trainer
from graphrl_jax.pretrain.config import PretrainConfig, PretrainHyper
from graphrl_jax.pretrain.trainer import prepare, sample_frames
from tests.helpers.demonstrations import demonstrations, with_images
from tests.helpers.graphs import OBJECTS

CONFIG = PretrainConfig(
    steps=60, batch_size=4, num_frames=6, encoder=EncoderConfig(num_layers=1, hidden=8, embedding=4)
)
# The paper's way; rearranged demonstrations have tests of their own.
HYPER = PretrainHyper(learning_rate=1e-2, temperature=0.1, rearranged=0.0)
DEMOS = demonstrations()
DATA = prepare(DEMOS)
INIT = jax.jit(trainer.init, static_argnums=(0, 1))
TRACES = []


@jax.jit
def train(hyper, key):
    TRACES.append(hyper)
    return trainer.run(CONFIG, hyper, DATA, trainer.init(CONFIG, OBJECTS, key), CONFIG.steps)


def finite(tree):
    return all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(tree))


@pytest.fixture(scope="module")
def trained():
    return train(HYPER, jax.random.key(0))


def test_every_part_of_the_loss_falls(trained):
    state, history = trained
    for name in ("loss", "tcc", "box", "class"):
        values = np.asarray(history[name])
        assert values.shape == (60,)
        assert np.mean(values[-5:]) < 0.8 * np.mean(values[:5]), name
    assert finite(state.params) and int(state.optimizer.step) == 60


def test_learning_rate_warms_up_and_decays(trained):
    rates = np.asarray(trained[1]["learning_rate"])
    assert rates[0] == 0.0 and np.max(rates) == pytest.approx(1e-2) and np.argmax(rates) == 3
    assert rates[-1] < 1e-4


def test_at_the_default_temperature_fresh_embeddings_are_not_one_point():
    # At an endless temperature all frames match alike, and the TCC has no gradient.
    temperatures = {"endless": 1e6, "xirl": 1.0, "default": PretrainHyper().temperature}
    first = {
        name: float(train(replace(HYPER, temperature=value), jax.random.key(0))[1]["tcc"][0])
        for name, value in temperatures.items()
    }
    assert abs(first["default"] - first["endless"]) > 20 * abs(first["xirl"] - first["endless"])


def test_new_numbers_and_seeds_do_not_trace_again(trained):
    changes = [dict(alpha=9.0), dict(learning_rate=1e-3), dict(suppress_robot=0.0), dict(tau=1.0), dict(warmup=0.0)]
    changes += [dict(rearranged=1.0)]
    before = np.asarray(trained[1]["loss"])
    for change in changes:
        assert not np.allclose(train(replace(HYPER, **change), jax.random.key(0))[1]["loss"], before), change
    assert not np.allclose(train(HYPER, jax.random.key(1))[1]["loss"], before)
    np.testing.assert_array_equal(train(HYPER, jax.random.key(0))[1]["loss"], before)
    assert len(TRACES) == 1


def test_the_papers_way_ignores_what_rearranging_is_told(trained):
    def losses(**changes: float) -> np.ndarray:
        return np.asarray(train(replace(HYPER, **changes), jax.random.key(0))[1]["loss"])

    paper = np.asarray(trained[1]["loss"])
    np.testing.assert_array_equal(paper, losses(rearranged=0.0, bumped=1.0, bumped_before=1.0, approach=1.0))
    mixed = losses(rearranged=1.0)
    assert np.isfinite(mixed).all() and not np.allclose(paper, mixed)


def test_chunks_equal_one_run(trained):
    state = INIT(CONFIG, OBJECTS, jax.random.key(0))
    losses = []
    for _ in range(3):
        state, history = trainer.run(CONFIG, HYPER, DATA, state, 20)
        losses.extend(np.asarray(history["loss"]))
    # Two programs round differently, and training amplifies it.
    np.testing.assert_allclose(losses[:5], trained[1]["loss"][:5], rtol=1e-4)
    np.testing.assert_allclose(losses, trained[1]["loss"], rtol=2e-3)
    assert int(state.optimizer.step) == 60


def test_a_map_over_seeds_and_alpha_equals_single_runs():
    keys = jax.random.split(jax.random.key(0), 2)
    alphas = np.array([1.0, 5.0], np.float32)
    hyper = replace(jax.tree.map(lambda value: np.full(2, value, np.float32), HYPER), alpha=alphas)

    @jax.jit
    @jax.vmap
    def train_early(hyper, key):
        return trainer.run(CONFIG, hyper, DATA, trainer.init(CONFIG, OBJECTS, key), 15)[1]["loss"]

    mapped = np.asarray(train_early(hyper, keys))
    for index in range(2):
        single = train(replace(HYPER, alpha=float(alphas[index])), keys[index])[1]
        # Early steps only: training is chaotic, and a batched product rounds differently.
        np.testing.assert_allclose(mapped[index], np.asarray(single["loss"])[:15], rtol=1e-2, atol=1e-4)


@pytest.mark.parametrize("decode_from", ["node", "pooled"])
def test_graphs_of_zero_total_weight_keep_the_training_finite(decode_from):
    demos = demonstrations(num=2, num_frames=5)
    # Every object is the robot, and so left out; one demonstration has no object at all.
    objects = ObjectTable(demos.objects.names, demos.objects.class_ids, (True,) * 4, demos.objects.class_names)
    mask = demos.mask.copy()
    mask[1] = False
    data = prepare(replace(demos, objects=objects, mask=mask))
    config = replace(CONFIG, steps=2, decode_from=decode_from)
    state, history = trainer.run(config, HYPER, data, INIT(config, objects, jax.random.key(0)), 2)
    assert finite(state.params) and finite(history)


SAMPLE = jax.jit(sample_frames, static_argnums=(2, 3))


@settings(max_examples=25, deadline=None)
@given(st.integers(1, 9), st.sampled_from([4, 9, 12]), st.integers(0, 2**16))
def test_frames_are_real_sorted_and_without_replacement(length, num_frames, seed):
    frames, mask = map(np.asarray, SAMPLE(jax.random.key(seed), length, 9, num_frames))
    drawn = frames[mask]
    assert len(drawn) == min(length, num_frames) and mask[: len(drawn)].all()
    assert (np.diff(drawn) > 0).all()
    assert frames.min() >= 0 and frames.max() < length
    if length <= num_frames:
        np.testing.assert_array_equal(drawn, np.arange(length))


def test_every_real_frame_is_drawn_equally_often():
    keys = jax.random.split(jax.random.key(0), 3000)
    frames, _ = jax.jit(jax.vmap(lambda key: sample_frames(key, 7, 9, 3)))(keys)
    counts = np.bincount(np.asarray(frames).ravel(), minlength=9)
    np.testing.assert_array_equal(counts[7:], 0)
    # 3 of 7: standard deviation of each count is sqrt(3000 * 3/7 * 4/7) = 27.
    assert (np.abs(counts[:7] - 3000 * 3 / 7) < 5 * 27).all()


def test_one_demonstration_is_too_few():
    with pytest.raises(ValueError, match="at least 2 demonstrations, got 1"):
        prepare(demonstrations(num=1))


def test_shown_frames_are_the_demonstrations_own_or_rearrangements_of_them():
    shown = trainer.shown_frames(PretrainConfig(), PretrainHyper(rearranged=0.0), DATA, jax.random.key(0), draws=2)
    last = DEMOS.lengths - 1
    frames = np.stack([0 * last, last // 2, last], axis=1)
    own = np.take_along_axis(DEMOS.boxes, frames[..., None, None], axis=1).repeat(2, axis=0)
    np.testing.assert_array_equal(shown.boxes, own)
    other = trainer.shown_frames(PretrainConfig(), PretrainHyper(), DATA, jax.random.key(0), draws=2)
    block = DEMOS.objects.names.index("block")
    np.testing.assert_allclose(other.boxes[:, 2, block], own[:, 2, block], atol=1e-6)
    assert not np.allclose(other.boxes, own) and other.active[:, 2, block].all()
    assert not other.active[:, 0, block].any()


@pytest.mark.parametrize("rule, expected", [("displacement", True), ("frame_motion", False), ("momentary", False)])
def test_pretraining_flags_what_moved_by_its_rule(rule, expected):
    # The block goes over two diagonals of its box, but far less than one from frame to frame.
    hyper = PretrainHyper(rearranged=0.0, tau=1.0)
    shown = trainer.shown_frames(PretrainConfig(activity=rule), hyper, DATA, jax.random.key(0), draws=1)
    block = DEMOS.objects.names.index("block")
    assert not shown.active[:, :2, block].any() and (shown.active[:, 2, block] == expected).all()


@pytest.mark.parametrize("rearranged", [0.0, 1.0])
def test_pretraining_without_persistence_sees_fewer_active_objects(rearranged):
    last = DEMOS.lengths - 1
    boxes = DEMOS.boxes.copy()
    boxes[np.arange(len(DEMOS)), last] = boxes[np.arange(len(DEMOS)), last - 1]  # they end at rest
    data = prepare(replace(DEMOS, boxes=boxes))
    hyper = PretrainHyper(rearranged=rearranged, bumped_before=0.0, tau=0.05)
    seen = [
        np.asarray(trainer.shown_frames(PretrainConfig(activity=rule), hyper, data, jax.random.key(0), 2).active)
        for rule in ("frame_motion", "momentary")
    ]
    # At the end everything that was moved counts as active, or only what still moves: in a rearrangement, what is
    # brought last.
    assert seen[0][:, 2].sum() > seen[1][:, 2].sum()
    assert seen[1][:, 2].any() == bool(rearranged)


def test_the_poolings_floats_are_pretrainings_of_the_same_name():
    hyper = PretrainHyper(alpha=3.0, suppress_robot=0.5, robot_messages=0.25, tau=0.1)
    expected = PoolingParams(alpha=3.0, suppress_robot=0.5, robot_messages=0.25, tau=0.1, activity="momentary")
    assert trainer.pooling_params(replace(CONFIG, activity="momentary"), hyper) == expected


def test_pretraining_aligns_images():
    demos = with_images(demonstrations(num=8), 16)
    sizes = PixelConfig(size=16, patch=4, widths=(16,))
    config = PretrainConfig(50, 8, 14, EncoderConfig(embedding=8, kind="pixels", pixels=sizes))
    hyper = PretrainHyper(temperature=0.1)
    state = INIT(config, OBJECTS, jax.random.key(1))
    assert "decoder" not in state.params
    _, history = trainer.run(config, hyper, prepare(demos, 16), state, config.steps)
    assert history["loss"][-10:].mean() < 0.5 * history["loss"][:3].mean()
    np.testing.assert_array_equal(history["box"], 0.0)


def draw_spots(boxes, mask, class_ids, turns):
    """An image of 16 pixels with a spot per object; its last pixel tells the angles of three of them."""
    at = jnp.clip((boxes[:, :2] * 16).astype(jnp.int32), 0, 14)
    spots = jnp.zeros((16, 16, 3)).at[at[:, 1], at[:, 0]].max(jnp.where(mask, 200.0, 0.0)[:, None])
    return spots.at[15, 15].set(jnp.round(100 + 30 * turns[:3])).astype(jnp.uint8)


@pytest.mark.parametrize("rearranged", [0.0, 1.0])
def test_images_are_those_of_the_videos_or_drawn_from_rearranged_boxes(rearranged):
    config = PretrainConfig(1, 4, 6, EncoderConfig(embedding=4, kind="pixels", pixels=PixelConfig(16, 4, (8,))))
    hyper = replace(HYPER, rearranged=rearranged)
    videos, data = prepare(with_images(DEMOS, 16), 16), prepare(with_images(DEMOS, 16), 16, draw_spots)
    key = jax.random.key(4)
    seen = np.asarray(trainer.shown_frames(config, hyper, data, key, 2))
    assert seen.shape == (2 * len(DEMOS), 3, 16, 16, 3) and seen.dtype == np.uint8
    if not rearranged:
        np.testing.assert_array_equal(seen, trainer.shown_frames(config, hyper, videos, key, 2))
        return
    # The scenes are those that an encoder of graphs is shown.
    graphs = trainer.shown_frames(CONFIG, hyper, DATA, key, 2)
    spots = np.clip((np.asarray(graphs.boxes)[..., :2] * 16).astype(int), 0, 14)
    for index in np.ndindex(seen.shape[:2]):
        there = np.asarray(graphs.mask)[index]
        column, row = spots[index][there].T
        assert (seen[index][row, column] == 200).all()
    # An object keeps its angle for the length of a demonstration, and has another one in the next.
    angles = seen[:, :, 15, 15]
    assert (angles == angles[:, :1]).all() and len(np.unique(angles[:, 0], axis=0)) == len(angles)


def test_images_of_another_size_are_refused():
    with pytest.raises(ValueError, match="frames must be images of 16 x 16 pixels, got those of 8 x 8 pixels"):
        prepare(with_images(demonstrations(num=2), 8), 16)
