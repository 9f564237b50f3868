"""Pretraining on a toy: it learns, resumes exactly, sweeps by vmap and compiles once."""

from dataclasses import replace
from functools import partial

import jax
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from synthetic import OBJECTS, demonstrations

from graphrl_jax import pretrain
from graphrl_jax.encoder import EncoderConfig
from graphrl_jax.graph import ObjectTable
from graphrl_jax.pretrain import PretrainConfig, PretrainHyper, prepare, sample_frames

CONFIG = PretrainConfig(
    steps=60, batch_size=4, num_frames=6, encoder=EncoderConfig(num_layers=1, hidden=8, embedding=4)
)
# The paper's way; rearranged demonstrations have tests of their own.
HYPER = PretrainHyper(learning_rate=1e-2, temperature=0.1, rearranged=0.0)
DATA = prepare(demonstrations())
TRACES = []


@jax.jit
def train(hyper, key):
    TRACES.append(hyper)
    return pretrain.train(CONFIG, hyper, DATA, key)


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


def test_chunks_equal_one_run(trained):
    state = jax.jit(pretrain.init, static_argnums=(0, 1))(CONFIG, OBJECTS, jax.random.key(0))
    losses = []
    for _ in range(3):
        state, history = pretrain.run(CONFIG, HYPER, DATA, state, 20)
        losses.extend(np.asarray(history["loss"]))
    # Two programs round differently, and training amplifies it.
    np.testing.assert_allclose(losses[:5], trained[1]["loss"][:5], rtol=1e-4)
    np.testing.assert_allclose(losses, trained[1]["loss"], rtol=2e-3)
    assert int(state.optimizer.step) == 60


def test_a_map_over_seeds_and_alpha_equals_single_runs(trained):
    keys = jax.random.split(jax.random.key(0), 2)
    alphas = np.array([1.0, 5.0], np.float32)
    hyper = replace(jax.tree.map(lambda value: np.full(2, value, np.float32), HYPER), alpha=alphas)
    mapped = jax.vmap(partial(pretrain.train, CONFIG), in_axes=(0, None, 0))(hyper, DATA, keys)[1]
    for index in range(2):
        single = train(replace(HYPER, alpha=float(alphas[index])), keys[index])[1]
        # Early steps only: training is chaotic, and a batched product rounds differently.
        np.testing.assert_allclose(
            np.asarray(mapped["loss"])[index, :15], np.asarray(single["loss"])[:15], rtol=1e-2, atol=1e-4
        )


@pytest.mark.parametrize("decode_from", ["node", "pooled"])
def test_graphs_of_zero_total_weight_keep_the_training_finite(decode_from):
    demos = demonstrations(num=2, num_frames=5)
    # Every object is the robot, and so left out; one demonstration has no object at all.
    objects = ObjectTable(demos.objects.names, demos.objects.class_ids, (True,) * 4, demos.objects.class_names)
    mask = demos.mask.copy()
    mask[1] = False
    data = prepare(replace(demos, objects=objects, mask=mask))
    config = replace(CONFIG, steps=2, decode_from=decode_from)
    state, history = pretrain.train(config, HYPER, data, jax.random.key(0))
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


@pytest.mark.parametrize(
    ("field", "value", "says"),
    [
        ("steps", 0, "steps must be at least 1, got 0"),
        ("batch_size", 1, "batch_size must be at least 2, got 1"),
        ("num_frames", 1, "num_frames must be at least 2, got 1"),
        ("decode_from", "nodes", "decode_from must be one of .*'node', 'pooled'.*, got 'nodes'"),
        ("tcc_variant", "mse", "tcc_variant must be one of .*'regression_mse'.*, got 'mse'"),
    ],
)
def test_a_wrong_configuration_names_the_field(field, value, says):
    with pytest.raises(ValueError, match=f"PretrainConfig.{says}"):
        PretrainConfig(**{field: value})


def test_one_demonstration_is_too_few():
    with pytest.raises(ValueError, match="at least 2 demonstrations, got 1"):
        prepare(demonstrations(num=1))
