"""Goal, scale and reward."""

from dataclasses import replace

import jax
import numpy as np
import pytest

from graphrl_jax.demonstrations import DemonstrationError
from graphrl_jax.encoder import encoder, pixels
from graphrl_jax.encoder.config import EncoderConfig, PixelConfig
from graphrl_jax.encoder.pooling import PoolingParams
from graphrl_jax.graph import sequence_graphs
from graphrl_jax.reward.model import (
    FARTHEST,
    MOST_EVENED,
    RewardModel,
    demonstration_embeddings,
    demonstration_rewards,
    embed_demonstrations,
    fit_reward,
)
from tests.helpers.demonstrations import demonstrations, with_images
from tests.helpers.graphs import OBJECTS

CONFIG = EncoderConfig(num_layers=1, hidden=4, embedding=3)
PARAMS = jax.jit(encoder.init, static_argnums=(1, 2))(jax.random.key(0), CONFIG, OBJECTS)
DEMOS = demonstrations(num=4, num_frames=10)
POOLING = PoolingParams(alpha=2.0, suppress_robot=1.0, tau=0.02)
LAST = DEMOS.lengths - 1


@pytest.fixture(scope="module")
def model() -> RewardModel:
    return fit_reward(PARAMS, DEMOS, POOLING)


@pytest.fixture(scope="module")
def embeddings() -> np.ndarray:
    return np.asarray(embed_demonstrations(PARAMS, DEMOS, POOLING))


@pytest.fixture(scope="module")
def graphs():
    """The graphs of the first demonstration, as numpy arrays with a leading time axis."""
    sequence = jax.jit(sequence_graphs, static_argnums=0)
    return jax.tree.map(
        np.asarray, sequence(DEMOS.objects, DEMOS.boxes[0], DEMOS.mask[0], DEMOS.lengths[0], POOLING.tau)
    )


def frame(graphs, index):
    return jax.tree.map(lambda field: field[index], graphs)


def test_goal_is_the_mean_over_last_real_frames(model, embeddings):
    np.testing.assert_allclose(model.goal, np.mean(embeddings[np.arange(4), LAST], axis=0), rtol=1e-5, atol=1e-6)


def test_kappa_is_one_over_the_mean_distance_of_first_frames(model, embeddings):
    distances = np.linalg.norm(embeddings[:, 0] - np.asarray(model.goal), axis=1)
    np.testing.assert_allclose(model.kappa, 1 / np.mean(distances), rtol=1e-5)
    rewards = np.asarray(demonstration_rewards(model, DEMOS))
    np.testing.assert_allclose(np.mean(rewards[:, 0]), -1.0, rtol=1e-5)


def test_reward_of_a_graph_is_minus_kappa_times_its_distance(model, embeddings, graphs):
    rewards = np.asarray(demonstration_rewards(model, DEMOS))
    apply = jax.jit(lambda model, graph: (model.embed(graph), model.distance(graph), model.apply(graph)))
    for t in (0, 5, 9):
        embedding, distance, reward = apply(model, frame(graphs, t))
        np.testing.assert_allclose(embedding, embeddings[0, t], rtol=1e-5, atol=1e-6)
        expected = np.linalg.norm(embeddings[0, t] - np.asarray(model.goal))
        np.testing.assert_allclose(distance, expected, rtol=1e-4, atol=1e-6)
        np.testing.assert_allclose(reward, -np.asarray(model.kappa) * expected, rtol=1e-4, atol=1e-5)
        np.testing.assert_allclose(reward, rewards[0, t], rtol=1e-4, atol=1e-5)


def test_reward_is_zero_at_a_single_goal_graph_and_its_gradient_finite(graphs):
    goal = frame(graphs, 9)
    shown = jax.tree.map(lambda leaf: np.stack([leaf] * 3)[None], goal)
    model = fit_reward(PARAMS, DEMOS, POOLING, shown=shown)
    np.testing.assert_allclose(jax.jit(RewardModel.apply)(model, goal), 0.0, atol=1e-5)
    exact = replace(model, goal=jax.jit(RewardModel.embed)(model, goal))
    for model in (exact, replace(exact, exponent=np.float32(0.5))):
        gradient = jax.jit(jax.grad(lambda boxes, model=model: model.apply(replace(goal, boxes=boxes))))(goal.boxes)
        assert np.isfinite(gradient).all()


def evened(graphs, middle: int) -> tuple[RewardModel, float]:
    """The model evened with the first demonstration's frames 0, `middle` and 9, and the distances' ratio by hand."""
    order = np.array([0, middle, 9])
    shown = jax.tree.map(lambda leaf: leaf[order][None], graphs)
    found = np.asarray(embed_demonstrations(PARAMS, DEMOS, POOLING))[0]
    first, half_time = (np.linalg.norm(found[frame] - found[9]) for frame in (0, middle))
    return fit_reward(PARAMS, DEMOS, POOLING, shown=shown, even=1.0), float(half_time / first)


def test_the_exponent_halves_the_reward_from_the_first_to_the_middle_frames(graphs):
    fits = [evened(graphs, middle) for middle in range(1, 9)]
    inside = [(model, ratio) for model, ratio in fits if 0.2 < ratio < 0.75]
    assert inside
    for model, ratio in inside:
        np.testing.assert_allclose(ratio ** np.asarray(model.exponent), 0.5, rtol=1e-4)
        np.testing.assert_allclose(model.value(2.0), -((2 * np.asarray(model.kappa)) ** model.exponent), rtol=1e-5)


def test_an_exponent_is_bounded_and_one_without_order_in_time(graphs):
    for model, ratio in (evened(graphs, middle) for middle in range(10)):
        exponent = float(model.exponent)
        assert 1 / MOST_EVENED <= exponent <= MOST_EVENED + 1e-5
        assert ratio < 1 or exponent == 1.0


def test_without_evening_the_exponent_is_the_given_one():
    evened = fit_reward(PARAMS, DEMOS, POOLING, even=1.0, exponent=0.25).exponent
    np.testing.assert_array_equal(evened, fit_reward(PARAMS, DEMOS, POOLING, even=1.0).exponent)
    assert fit_reward(PARAMS, DEMOS, POOLING, exponent=0.25).exponent == 0.25
    between = fit_reward(PARAMS, DEMOS, POOLING, even=0.5, exponent=0.25).exponent
    np.testing.assert_allclose(between, (0.25 + evened) / 2, rtol=1e-6)


def test_equation_3_has_exponent_one(model):
    assert float(model.exponent) == 1.0
    np.testing.assert_allclose(model.value(2.0), -2 * np.asarray(model.kappa), rtol=1e-6)


@pytest.mark.parametrize("exponent", [0.5, 1.0, 3.0])
def test_what_is_farther_than_the_farthest_costs_no_more(model, exponent):
    model = replace(model, kappa=np.float32(0.5), exponent=np.float32(exponent))
    scaled = np.array([0.0, 0.3, 1.0, 1.999, FARTHEST, 2.001, 50.0], np.float32)
    rewards = np.asarray(model.value(scaled / 0.5))
    np.testing.assert_allclose(rewards, -(np.minimum(scaled, FARTHEST) ** exponent), rtol=1e-5)
    assert (np.diff(rewards[:5]) < 0).all() and (rewards[4:] == rewards[4]).all()


def test_another_encoder_goal_or_scale_does_not_trace_again(model, graphs):
    traces = []

    @jax.jit
    def counted(model, graph):
        traces.append(graph)
        return model.apply(graph)

    scaled = replace(
        model, kappa=np.float32(2) * np.asarray(model.kappa), pooling=replace(model.pooling, alpha=np.float32(7))
    )
    other = replace(model, params=jax.tree.map(lambda leaf: np.asarray(leaf) + np.float32(1), model.params))
    rewards = [float(counted(each, frame(graphs, 4))) for each in (model, scaled, other)]
    assert len(traces) == 1 and len(set(rewards)) == 3


def test_padding_of_demonstrations_does_not_matter(model):
    boxes = DEMOS.boxes.copy()
    boxes[~(np.arange(10) < DEMOS.lengths[:, None])] = 1e30
    refitted = fit_reward(PARAMS, replace(DEMOS, boxes=boxes), POOLING)
    jax.tree.map(np.testing.assert_array_equal, refitted, model)


def test_failures_have_no_goal():
    mixed = replace(DEMOS, success=np.array([True, False, True, False]))
    with pytest.raises(ValueError, match=r"2 of 4 demonstrations are failures; pass demonstrations.successes\(\)"):
        fit_reward(PARAMS, mixed, POOLING)


def test_demonstrations_that_start_at_the_goal_have_no_scale():
    still = replace(DEMOS, boxes=np.full_like(DEMOS.boxes, 0.5))
    with pytest.raises(ValueError, match="must differ from the goal, got a mean distance of 0.0"):
        fit_reward(PARAMS, still, POOLING)


def test_embeddings_of_a_model_are_those_of_its_encoder(model, embeddings):
    np.testing.assert_allclose(demonstration_embeddings(model, DEMOS), embeddings, rtol=1e-6)


IMAGE_DEMOS = with_images(DEMOS, 8)
IMAGE_PARAMS = pixels.init(jax.random.key(0), PixelConfig(size=8, patch=2, widths=(3, 4), blocks=1), 5)


@pytest.fixture(scope="module")
def image_model() -> RewardModel:
    """A reward of images, by an encoder that has learned nothing."""
    return fit_reward(IMAGE_PARAMS, IMAGE_DEMOS, PoolingParams(1.0, 0.0), image_size=8)


def test_the_reward_falls_with_the_distance_of_images_to_the_last_ones(image_model):
    embed = jax.jit(jax.vmap(pixels.encode, (None, 0)))
    frames = IMAGE_DEMOS.frames
    goal = np.asarray(embed(IMAGE_PARAMS, frames[np.arange(4), LAST])).mean(0)
    np.testing.assert_allclose(image_model.goal, goal, rtol=1e-4, atol=1e-5)
    distances = np.linalg.norm(np.asarray(embed(IMAGE_PARAMS, frames[0])) - goal, axis=-1)
    expected = -np.minimum(np.asarray(image_model.kappa) * distances, FARTHEST)
    rewards = demonstration_rewards(image_model, IMAGE_DEMOS)
    np.testing.assert_allclose(rewards[0], expected, rtol=1e-3, atol=1e-4)
    np.testing.assert_allclose(jax.jit(RewardModel.apply)(image_model, frames[0, 3]), rewards[0, 3], rtol=1e-4)
    assert np.ptp(expected) > 0.1


def test_a_reward_of_images_asks_for_images(image_model):
    with pytest.raises(DemonstrationError, match="frames must be images of 8 x 8 pixels, got none"):
        demonstration_rewards(image_model, DEMOS)
    with pytest.raises(DemonstrationError, match="frames must be images of 16 x 16 pixels, got those of 8 x 8 pixels"):
        fit_reward(IMAGE_PARAMS, IMAGE_DEMOS, POOLING, image_size=16)
