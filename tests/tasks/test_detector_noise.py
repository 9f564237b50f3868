"""Detector noise: none by default, and each kind of it alone does what it says."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tasks.detector_noise import DetectorNoise, visible_share

# A large box in the middle, a small one right behind it, one half behind it, and one apart.
BOXES = np.array([[0.5, 0.5, 0.4, 0.4], [0.5, 0.5, 0.1, 0.1], [0.7, 0.5, 0.2, 0.2], [0.1, 0.1, 0.1, 0.1]], np.float32)
DEPTHS = jnp.array([1.0, 2.0, 2.0, 2.0])
HIDES = np.ones(4, bool)
KEYS = jax.random.split(jax.random.key(0), 2000)


def see(noise, hides=HIDES):
    boxes, mask = jax.vmap(lambda key: noise.see(key, BOXES, DEPTHS, hides))(KEYS)
    return np.asarray(boxes), np.asarray(mask)


def test_a_perfect_detector_changes_nothing():
    boxes, mask = see(DetectorNoise())
    np.testing.assert_array_equal(boxes, np.broadcast_to(BOXES, boxes.shape))
    assert mask.all()


def test_what_is_covered_by_nearer_boxes_is_hidden():
    share = np.asarray(visible_share(BOXES, DEPTHS, HIDES))
    np.testing.assert_allclose(share[[0, 1, 3]], [1.0, 0.0, 1.0])
    assert share[2] == pytest.approx(0.5, abs=0.1)
    np.testing.assert_array_equal(see(DetectorNoise(visible=0.3))[1][0], [True, False, True, True])
    np.testing.assert_array_equal(see(DetectorNoise(visible=0.9))[1][0], [True, False, False, True])


def test_what_does_not_hide_hides_nothing():
    assert see(DetectorNoise(visible=0.9), hides=np.array([False, True, True, True]))[1].all()


def test_dropout_misses_as_many_as_it_says():
    boxes, mask = see(DetectorNoise(dropout=0.2))
    np.testing.assert_allclose((~mask).mean(0), 0.2, atol=0.04)
    np.testing.assert_array_equal(boxes, np.broadcast_to(BOXES, boxes.shape))


def test_jitter_is_relative_to_the_boxs_sides():
    boxes, mask = see(DetectorNoise(jitter=0.05))
    offsets = (boxes[..., :2] - BOXES[:, :2]) / BOXES[:, 2:]
    growth = np.log(boxes[..., 2:] / BOXES[:, 2:])
    np.testing.assert_allclose([offsets.std((0, 2)), growth.std((0, 2))], 0.05, rtol=0.1)
    assert np.abs(offsets.mean((0, 2))).max() < 0.01 and mask.all() and (boxes[..., 2:] > 0).all()


@pytest.mark.parametrize("field, value", [("jitter", -0.1), ("dropout", 1.5), ("visible", 2.0)])
def test_a_wrong_value_names_the_field(field, value):
    with pytest.raises(ValueError, match=f"DetectorNoise.{field} is {value}; allowed: 0 to 1"):
        DetectorNoise(**{field: value})
