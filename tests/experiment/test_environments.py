"""Environments by method; a reward of images is paid for, and audited by, images."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from graphrl_jax.encoder import pixels
from graphrl_jax.encoder.config import PixelConfig
from graphrl_jax.encoder.pooling import PoolingParams
from graphrl_jax.experiment.environments import (
    TrainingParams,
    drawer_of,
    environment_of,
    image_drawer,
    refuse_undrawn,
    training_environment_of,
)
from graphrl_jax.experiment.methods import METHODS
from graphrl_jax.experiment.settings import compose
from graphrl_jax.registry import make_task
from graphrl_jax.reward.landscape import audit
from graphrl_jax.reward.model import fit_reward
from graphrl_jax.rl.wrappers import WRAPPERS, ImageReward
from tests.helpers.probe_environments import SlidingBoxes


def test_a_task_and_reward_have_one_function_that_programs_are_known_by():
    task, other = SlidingBoxes(), SlidingBoxes()
    assert environment_of(task, "env") is environment_of(task, "env")
    assert environment_of(task, "env") is not environment_of(other, "env")
    env = environment_of(task, "env")(PoolingParams())
    assert type(env) is WRAPPERS["nothing"] and env.env is task


def test_a_training_environment_has_the_tasks_starts_and_is_known_by_one_function_too():
    task, starts = make_task("shoes_in_box"), jnp.zeros(3)
    make_env = training_environment_of(task, "env")
    assert make_env is training_environment_of(task, "env") and make_env is not environment_of(task, "env")
    env = make_env(TrainingParams(PoolingParams(tau=0.5), starts))
    assert type(env) is WRAPPERS["nothing"] and env.pooling.tau == 0.5
    assert env.env.starts is starts and task.starts is None and env.env.engine is task.engine


@pytest.mark.parametrize("reward", METHODS)
def test_only_rewards_of_images_need_a_task_that_draws(reward):
    shoes = make_task("shoes_in_box")
    refuse_undrawn(make_task("match_regions"), reward)
    if METHODS[reward].needs == "images":
        with pytest.raises(ValueError, match="task shoes_in_box draws no images inside a program"):
            refuse_undrawn(shoes, reward)
    else:
        refuse_undrawn(shoes, reward, rearranged=1.0)


def test_images_of_rearrangements_need_a_task_that_draws_boxes(outside_package):
    carry = make_task("carry")
    refuse_undrawn(make_task("match_regions"), "xirl", rearranged=1.0)
    refuse_undrawn(carry, "xirl")
    with pytest.raises(ValueError, match="task carry draws no images of boxes; allowed: pretrain.rearranged 0"):
        refuse_undrawn(carry, "xirl", rearranged=0.5)


def test_drawers_are_those_of_rewards_that_learn_from_drawings():
    task = make_task("match_regions")
    for reward, pretrain in (("xirl", {}), ("graph", {"rearranged": 1.0})):
        assert drawer_of(task, compose(task, reward, pretrain=pretrain)) is None
    settings = compose(task, "xirl", pretrain={"rearranged": 0.5})
    draw = drawer_of(task, settings)
    assert draw is drawer_of(task, settings)  # so that programs compiled for it are used again
    slots = task.objects.num_slots
    image = draw(np.full((slots, 4), 0.5), np.ones(slots, bool), np.array(task.objects.class_ids), np.zeros(slots))
    assert image.shape == (64, 64, 3) and image.dtype == np.uint8 and len(np.unique(image.reshape(-1, 3), axis=0)) > 3


@pytest.fixture(scope="module")
def carry(outside_package):
    return make_task("carry")


@pytest.fixture(scope="module")
def image_reward(carry):
    """A reward of images, by an encoder that has learned nothing."""
    params = pixels.init(jax.random.key(0), PixelConfig(size=8, patch=2, widths=(3, 4), blocks=1), 5)
    demos = carry.demonstrate(jax.random.key(0), 4, image_size=8)
    return fit_reward(params, demos, PoolingParams(1.0, 0.0), image_size=8)


@pytest.mark.parametrize("reward", METHODS)
def test_an_environment_pays_what_its_method_needs(carry, image_reward, reward):
    needs = METHODS[reward].needs
    env = environment_of(carry, reward)(PoolingParams() if needs == "nothing" else image_reward)
    assert type(env) is WRAPPERS[needs] and env.env is carry


def test_an_environment_pays_for_the_image_after_the_step(carry, image_reward):
    env = environment_of(carry, "xirl")(image_reward)
    assert isinstance(env, ImageReward)
    state = jax.jit(lambda key: env.step(env.reset(key), jnp.array([1.0, 0.0])))(jax.random.key(1))
    image = carry.image(state.pipeline_state, 8)
    np.testing.assert_allclose(state.reward, image_reward.apply(image), rtol=1e-5)
    assert float(state.metrics["learned_reward"]) == float(state.reward) != float(state.metrics["env_reward"])


def test_an_audit_shows_a_reward_of_images_what_the_task_draws(carry, image_reward):
    landscape = carry.landscape(jax.random.key(2))
    draw_image = image_drawer(carry, image_reward)
    assert draw_image is not None and draw_image is image_drawer(carry, image_reward)
    report = audit(image_reward, landscape, draw_image)
    state = jax.tree.map(lambda leaf: leaf[3, 5], landscape.grids[0].scenes.states)
    expected = image_reward.apply(carry.image(state, 8))
    np.testing.assert_allclose(report.grids[0].values[3, 5], expected, rtol=1e-3, atol=1e-4)
    assert report.bump_bonus == 0.0  # images know of no activity


def test_a_reward_of_graphs_is_drawn_nothing(carry, image_reward):
    assert image_drawer(carry, replace(image_reward, image_size=None)) is None
