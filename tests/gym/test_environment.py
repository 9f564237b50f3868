"""One environment: Gymnasium's own checks, the reward, the end of an episode, drawings, refusals."""

from dataclasses import replace

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env

from graphrl_jax.gym import TaskEnv
from graphrl_jax.reward.model import RewardModel
from tests.helpers.outside_package import REPOSITORY

SHOES = REPOSITORY / "checkpoints" / "shoes_in_box_graph"
GOAL = np.array([0.8, 0.3], np.float32)  # of the example task


@pytest.mark.parametrize("learned", [False, True])
def test_gymnasiums_checks_pass_without_a_warning(model, learned):
    """Warnings are errors in tests."""
    env = gymnasium.make("graphrl/MatchRegions-v0", reward_model=model if learned else None)
    check_env(env.unwrapped)


def test_the_learned_reward_is_the_models_and_the_tasks_own_is_told(model):
    learned = gymnasium.make("graphrl/MatchRegions-v0", reward_model=REPOSITORY / "checkpoints/match_regions_graph")
    plain = gymnasium.make("graphrl/MatchRegions-v0")
    frames, rewards = [learned.reset(seed=5)[1]], []
    plain.reset(seed=5)
    learned.action_space.seed(0)
    for _ in range(6):
        action = learned.action_space.sample()
        _, reward, *_, info = learned.step(action)
        _, own, *_, told = plain.step(action)
        assert info["environment_reward"] == told["environment_reward"] == own != reward
        frames.append(info)
        rewards.append(reward)
    boxes, mask = (np.stack([info[name] for info in frames]) for name in ("boxes", "mask"))
    np.testing.assert_allclose(rewards, model.rewards(boxes, mask)[1:], atol=1e-5)


def test_the_observation_is_the_tasks_followed_by_what_has_moved(carry):
    env = gymnasium.make(carry)
    observation, info = env.reset(seed=0)
    robot, block = observation[:2], observation[2:4]
    np.testing.assert_array_equal(observation[4:], 0)
    np.testing.assert_array_equal(info["boxes"][1:, :2], [robot, block])
    moved, reward, _, _, info = env.step(np.array([1.0, 1.0]))
    np.testing.assert_array_equal(moved[4:], [0, 1, 0])  # region, robot, block
    np.testing.assert_array_equal(info["active"], [False, True, False])
    assert reward == pytest.approx(-np.linalg.norm(block - GOAL), abs=1e-6)


def test_an_episode_is_cut_off_at_its_length_and_does_not_end_by_success(carry):
    env = gymnasium.make(carry)
    (observation, _), successes = env.reset(seed=0), 0
    for step in range(30):
        robot, block = observation[:2], observation[2:4]
        target = GOAL if np.linalg.norm(robot - block) < 0.1 else block
        observation, _, terminated, truncated, info = env.step((target - robot) / 0.08)
        assert terminated is False and truncated is (step == 29)
        assert info["success"] is bool(info["events"][0])
        successes += info["success"]
    assert 1 < successes < 30


def test_a_start_depends_on_the_seed_and_the_number_of_its_episode_alone(carry):
    env = gymnasium.make(carry)

    def starts(steps: int) -> list[np.ndarray]:
        found = [env.reset(seed=3)[0]]
        for _ in range(2):
            for _ in range(steps):
                env.step(env.action_space.sample())
            found.append(env.reset()[0])
        return found

    first, second = starts(0), starts(4)
    np.testing.assert_array_equal(first, second)
    assert len(np.unique(first, axis=0)) == 3
    assert not np.array_equal(env.reset(seed=4)[0], first[0])


def test_a_state_that_is_not_finite_ends_its_episode(carry):
    env = gymnasium.make(carry)
    env.reset(seed=0)
    observation, reward, terminated, truncated, _ = env.step(np.full(2, np.nan))
    assert (reward, terminated, truncated) == (0.0, False, True)
    assert observation in env.observation_space
    assert np.isfinite(env.reset()[0]).all()


@pytest.mark.parametrize(("task", "edge"), [("match_regions", 320), ("carry", 64)])
def test_drawings_are_the_tasks_and_show_what_happens(carry, task, edge):
    env = TaskEnv(task, render_mode="rgb_array")
    env.reset(seed=0)
    first = env.render()
    assert first.shape == (edge, edge, 3) and first.dtype == np.uint8 and len(np.unique(first)) > 1
    np.testing.assert_array_equal(env.render(), first)
    for _ in range(20):
        env.step(np.ones(env.action_space.shape))
    after = env.render()
    assert (after != first).any() or task == "carry"  # which draws the block alone
    blind = TaskEnv(task)
    blind.reset(seed=0)
    assert blind.render() is None


def test_training_starts_are_those_of_policy_training(carry):
    def moved(training: bool) -> int:
        env = TaskEnv("match_regions", training=training)
        return sum(env.reset(seed=seed)[1]["active"].any() for seed in range(8))

    assert moved(False) == 0 < moved(True)


def test_it_is_one_sentence_that_refuses(model):
    shoes = RewardModel.load(SHOES)
    with pytest.raises(ValueError, match="unknown task 'chess'; known tasks: "):
        TaskEnv("chess")
    with pytest.raises(ValueError, match="unknown engine 'bullet'; known engines: mjx"):
        TaskEnv("match_regions", engine="bullet")
    with pytest.raises(
        ValueError, match="reward_model is of the objects gripper, .*; task match_regions has goal_region"
    ):
        TaskEnv("match_regions", reward_model=shoes)
    with pytest.raises(ValueError, match="takes 4 frames per second; allowed: 8"):
        TaskEnv("match_regions", reward_model=replace(model, card=replace(model.card, frame_rate=4.0)))
    with pytest.raises(ValueError, match="reward_model has no card"):
        TaskEnv("match_regions", reward_model=replace(model, card=None))
    with pytest.raises(ValueError, match="config.json is missing"):
        TaskEnv("match_regions", reward_model=REPOSITORY / "docs")
    with pytest.raises(ValueError, match="render_mode is 'human'; allowed: rgb_array, or None"):
        TaskEnv("match_regions", render_mode="human")


def test_what_is_asked_in_the_wrong_order_or_shape_is_refused():
    env = TaskEnv("match_regions", render_mode="rgb_array")
    for ask in (lambda: env.step(np.zeros(3)), env.render):
        with pytest.raises(ResetNeeded, match="needs a reset before"):
            ask()
    with pytest.raises(ValueError, match="reset got the options layout; allowed: none"):
        env.reset(options={"layout": 3})
    env.reset(seed=0)
    with pytest.raises(ValueError, match=r"step takes actions of shape \(3,\), got \(2,\)"):
        env.step(np.zeros(2))
