"""Rearranged demonstrations: what must stay, what must vary, and how the way to go falls."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from synthetic import demonstrations

from graphrl_jax import pretrain
from graphrl_jax.augment import Motion, motion, rearrange
from graphrl_jax.encoder import EncoderConfig
from graphrl_jax.graph import ObjectTable

OBJECTS = ObjectTable(
    names=("region", "robot", "first", "second", "bystander"),
    class_ids=(0, 1, 2, 2, 2),
    is_robot=(False, True, False, False, False),
    class_names=("region", "robot", "block"),
    is_fixture=(True, False, False, False, False),
)
REGION, ROBOT, FIRST, SECOND, BYSTANDER = range(5)
# The first block ends in the region, the second beside it.
START = np.array(
    [[0.5, 0.5, 0.2, 0.3], [0.2, 0.2, 0.2, 0.2], [0.4, 0.3, 0.1, 0.1], [0.6, 0.8, 0.1, 0.1], [0.3, 0.7, 0.1, 0.1]]
)
END = np.array(
    [[0.5, 0.5, 0.2, 0.3], [0.6, 0.4, 0.2, 0.2], [0.5, 0.45, 0.1, 0.1], [0.65, 0.7, 0.12, 0.1], [0.3, 0.7, 0.1, 0.1]]
)
MOVED = np.array([False, True, True, True, False])
MOTION = Motion(
    jnp.zeros((2, 5), bool), jnp.asarray(MOVED), jnp.asarray(START, jnp.float32), jnp.asarray(END, jnp.float32)
)
TOTAL = np.linalg.norm(END[2:4, :2] - START[2:4, :2], axis=-1).sum()
TIMES = np.linspace(0, 1, 21, dtype=np.float32)
NUM = 64


@jax.jit
def many(bumped: float) -> tuple[jax.Array, jax.Array]:
    keys = jax.random.split(jax.random.key(0), NUM)
    return jax.vmap(lambda key: rearrange(key, OBJECTS, MOTION, TIMES, bumped))(keys)


@pytest.fixture(scope="module")
def rearranged() -> tuple[np.ndarray, np.ndarray]:
    boxes, active = many(0.0)
    return np.asarray(boxes), np.asarray(active)


def test_fixtures_stay_and_goals_are_kept(rearranged):
    boxes, active = rearranged
    np.testing.assert_array_equal(boxes[:, :, REGION], np.broadcast_to(MOTION.first[REGION], (NUM, 21, 4)))
    assert not active[:, :, REGION].any()
    np.testing.assert_allclose(boxes[:, -1, SECOND], np.broadcast_to(MOTION.last[SECOND], (NUM, 4)), atol=1e-6)
    inside = np.abs(boxes[:, -1, FIRST, :2] - START[REGION, :2]) <= START[REGION, 2:] / 2
    assert inside.all() and (boxes[:, -1, FIRST, :2].std(axis=0) > 0.03).all()


def test_the_way_to_go_is_the_demonstrations_and_falls_evenly(rearranged):
    centres = rearranged[0][:, :, [FIRST, SECOND], :2]
    left = np.linalg.norm(centres - centres[:, -1:], axis=-1).sum(-1)
    # So short a way is never cut by the image's border.
    np.testing.assert_allclose(left, TOTAL * np.broadcast_to(1 - TIMES, left.shape), atol=0.01 * TOTAL)
    shares = np.linalg.norm(centres[:, 0] - centres[:, -1], axis=-1)[:, 0] / TOTAL
    assert shares.min() < 0.2 and shares.max() > 0.8


def test_objects_become_active_when_they_set_off_and_stay_so(rearranged):
    boxes, active = rearranged
    assert (np.diff(active.astype(int), axis=1) >= 0).all()
    away = np.abs(boxes[..., :2] - boxes[:, :1, :, :2]).max(-1) > 1e-4
    assert active[away].all() and active[:, -1, [FIRST, SECOND]].all() and not active[:, 0].any()
    assert {True, False} == set((active[:, :, FIRST].argmax(1) < active[:, :, SECOND].argmax(1)).tolist())


def test_what_was_never_moved_lies_anywhere_and_is_bumped_on_request(rearranged):
    boxes, active = rearranged
    still = boxes[:, :, BYSTANDER]
    np.testing.assert_array_equal(still, np.broadcast_to(still[:, :1], still.shape))
    assert not active[:, :, BYSTANDER].any() and (still[:, 0, :2].std(axis=0) > 0.15).all()
    bumped_boxes, bumped = map(np.asarray, many(1.0))
    # A move of its own may begin after the last object has arrived, and then is not seen.
    assert bumped[:, -1, BYSTANDER].mean() > 0.6
    went = np.abs(bumped_boxes[:, -1] - bumped_boxes[:, 0])[:, BYSTANDER].max(-1) > 0
    np.testing.assert_array_equal(went, bumped[:, -1, BYSTANDER])


def test_the_robot_tells_nothing_of_the_goal(rearranged):
    places = rearranged[0][:, :, ROBOT, :2]
    assert (places[:, 0].std(axis=0) > 0.15).all() and (places[:, -1].std(axis=0) > 0.15).all()


def test_motion_skips_frames_without_the_object_and_padding():
    boxes = jnp.arange(5.0)[:, None, None] * jnp.array([0.0, 0.1])[:, None] + jnp.full((5, 2, 4), 0.2)
    mask = jnp.array([[True, False], [True, True], [True, True], [True, False], [True, True]])
    found = motion(boxes, mask, 4, 0.01)
    np.testing.assert_array_equal(found.moved, [False, True])
    np.testing.assert_array_equal(found.first[1], boxes[1, 1])
    np.testing.assert_array_equal(found.last[1], boxes[2, 1])


def test_the_papers_way_ignores_what_rearranging_is_told():
    config = pretrain.PretrainConfig(steps=3, batch_size=4, num_frames=6, encoder=EncoderConfig(1, 8, 4))
    data = pretrain.prepare(demonstrations())

    def losses(**changes: float) -> np.ndarray:
        hyper = replace(pretrain.PretrainHyper(learning_rate=1e-2), **changes)
        return np.asarray(pretrain.train(config, hyper, data, jax.random.key(0))[1]["loss"])

    paper = losses(rearranged=0.0)
    np.testing.assert_array_equal(paper, losses(rearranged=0.0, bumped=1.0))
    mixed = losses(rearranged=1.0)
    assert np.isfinite(mixed).all() and not np.allclose(paper, mixed)
