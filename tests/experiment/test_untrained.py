"""Policies that have learned nothing, on the example task."""

from dataclasses import replace

import imageio.v2 as imageio
import jax
import numpy as np
import pytest
from brax.envs.base import State

from graphrl_jax.encoder import encoder, pixels
from graphrl_jax.encoder.config import EncoderConfig, PixelConfig
from graphrl_jax.encoder.pooling import PoolingParams
from graphrl_jax.experiment.keys import RunStage, stage_key
from graphrl_jax.experiment.untrained import evaluate_untrained, show_untrained, untrained
from graphrl_jax.registry import make_task
from graphrl_jax.reward.card import Card
from graphrl_jax.reward.model import RewardModel, fit_reward
from graphrl_jax.task import Task
from tests.helpers.graphs import OBJECTS

EPISODES = 8
GOAL = np.array([0.8, 0.3])


@pytest.fixture(scope="module")
def carry(outside_package) -> Task:
    return make_task("carry")


@pytest.fixture(scope="module")
def model(carry) -> RewardModel:
    """A reward model of the task's graphs, by an encoder that has learned nothing."""
    config = EncoderConfig(num_layers=1, hidden=4, embedding=3)
    params = jax.jit(encoder.init, static_argnums=(1, 2))(jax.random.key(0), config, carry.objects)
    card = Card(carry.objects, carry.frame_rate, config, "displacement", "carry", "made up", 4, -0.1)
    return replace(fit_reward(params, carry.demonstrate(jax.random.key(0), 4), PoolingParams()), card=card)


def starts(carry: Task, seed: int) -> State:
    """The first state of each episode of an evaluation."""
    reset_key, _ = jax.random.split(stage_key(seed, RunStage.EVALUATION))
    return jax.vmap(carry.reset)(jax.random.split(reset_key, EPISODES))


def test_who_does_nothing_is_paid_for_the_start(carry):
    found = evaluate_untrained(untrained(carry, "zero"), EPISODES, 3)
    paid = -30 * np.linalg.norm(np.asarray(starts(carry, 3).pipeline_state.block) - GOAL, axis=1).mean()
    assert found.keys() == {"success_rate", "mean_score", "episodes", "mean_return", "seed"}
    np.testing.assert_allclose(found["mean_return"], paid, rtol=1e-5)
    assert (found["success_rate"], found["episodes"], found["seed"]) == (0.0, EPISODES, 3)


def test_the_expert_succeeds_and_is_paid_more(carry):
    found = {name: evaluate_untrained(untrained(carry, name), EPISODES, 3) for name in ("zero", "random", "expert")}
    assert [one["success_rate"] for one in found.values()] == [0.0, 0.0, 1.0]
    assert found["expert"]["mean_return"] > found["random"]["mean_return"] + 5


def test_a_reward_model_pays_what_it_says_of_the_same_episodes(carry, model):
    own, learned = (evaluate_untrained(untrained(carry, "zero", one), EPISODES, 3) for one in (None, model))
    assert own["success_rate"] == learned["success_rate"] == 0.0
    # Nothing moves, so that every one of the 30 steps is paid alike.
    boxes, mask = jax.vmap(carry.boxes)(starts(carry, 3))
    rewards = [model.rewards(boxes[index, None], mask[index, None])[0] for index in range(EPISODES)]
    np.testing.assert_allclose(learned["mean_return"], 30 * np.mean(rewards), rtol=1e-4)


def test_a_reward_model_of_images_is_shown_what_the_task_draws(carry, model):
    config = PixelConfig(size=8, patch=2, widths=(3, 4), blocks=1)
    params = pixels.init(jax.random.key(0), config, 5)
    demos = carry.demonstrate(jax.random.key(0), 4, image_size=8)
    images = replace(fit_reward(params, demos, PoolingParams(1.0, 0.0), image_size=8), card=model.card)
    found = evaluate_untrained(untrained(carry, "zero", images), EPISODES, 3)
    drawn = jax.vmap(lambda places: images.apply(carry.image(places, 8)))(starts(carry, 3).pipeline_state)
    np.testing.assert_allclose(found["mean_return"], 30 * np.mean(drawn), rtol=1e-4)


def test_a_reward_model_of_other_objects_is_refused(carry, model):
    other = replace(model, card=replace(model.card, objects=OBJECTS))
    with pytest.raises(ValueError, match="the reward model has other objects than task carry"):
        untrained(carry, "zero", other)


def test_a_video_shows_every_frame(carry, tmp_path):
    show_untrained(untrained(carry, "expert"), 2, 3, tmp_path / "expert.mp4")
    first, second = np.split(np.stack(imageio.mimread(tmp_path / "expert.mp4")), 2)
    assert first.shape == second.shape == (30, 64, 64, 3)
    # The block, a green square, ends at the goal.
    rows, columns = np.nonzero(first[-1, ..., 0] < 100)
    np.testing.assert_allclose([columns.mean() / 64, rows.mean() / 64], GOAL, atol=0.1)
