"""Many environments in one program do what single ones do, and say so as Gymnasium's own vector environments."""

from dataclasses import replace

import gymnasium
import jax
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import data_equivalence
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers.vector import RecordEpisodeStatistics

from graphrl_jax.gym import TaskVectorEnv, simulation


def test_it_is_as_good_as_single_environments_one_by_one(carry):
    """Observations, rewards, ends and infos of 65 steps, over two ends of episodes."""
    ours = TaskVectorEnv("carry", num_envs=3)
    theirs = SyncVectorEnv([lambda: gymnasium.make(carry)] * 3, autoreset_mode=AutoresetMode.SAME_STEP)
    assert (ours.observation_space, ours.action_space) == (theirs.observation_space, theirs.action_space)
    assert data_equivalence(ours.reset(seed=7), theirs.reset(seed=7))
    ours.action_space.seed(0)
    ends = 0
    for _ in range(65):
        actions = ours.action_space.sample()
        found, expected = ours.step(actions), theirs.step(actions)
        assert data_equivalence(found, expected), (found, expected)
        ends += "final_obs" in found[-1]
    assert ends == 2
    assert data_equivalence(ours.reset(), theirs.reset())


def test_the_end_of_an_episode_is_told_beside_the_next_start(carry):
    envs = gymnasium.make_vec(carry, num_envs=2)
    first, _ = envs.reset(seed=0)
    for _ in range(29):
        *_, infos = envs.step(np.ones((2, 2)))
        assert "final_obs" not in infos and "final_info" not in infos
    last, rewards, terminations, truncations, infos = envs.step(np.ones((2, 2)))
    assert truncations.all() and not terminations.any() and (rewards < 0).all() and rewards.dtype == np.float64
    np.testing.assert_array_equal(infos["_final_obs"], [True, True])
    for index, observation in enumerate(infos["final_obs"]):
        np.testing.assert_array_equal(observation[:2], [1, 1])  # the robot is in the corner
        assert not np.array_equal(last[index], first[index]) and (last[index, :4] <= 0.4).all()
    np.testing.assert_array_equal(infos["final_info"]["environment_reward"], rewards)
    assert not infos["environment_reward"].any() and infos["final_info"]["_boxes"].all()


def test_only_what_has_ended_has_an_end(carry):
    envs = TaskVectorEnv("carry", num_envs=2)
    envs.reset(seed=0)
    observations, rewards, _, truncations, infos = envs.step(np.array([[np.nan, 0.0], [0.0, 0.0]]))
    np.testing.assert_array_equal(truncations, [True, False])
    assert infos["final_obs"][0] in envs.single_observation_space and infos["final_obs"][1] is None
    assert observations in envs.observation_space and rewards[0] == 0.0
    assert infos["final_info"]["score"].tolist() == [0, 0]
    np.testing.assert_array_equal(infos["final_info"]["_mask"], [True, False])
    np.testing.assert_array_equal(infos["final_info"]["mask"][1], False)
    assert infos["mask"].all()


def test_a_new_seed_or_reward_compiles_nothing(monkeypatch, model):
    traces: list[str] = []
    frame = simulation._frame
    monkeypatch.setattr(simulation, "_frame", lambda task, state: traces.append(task.name) or frame(task, state))

    def run(reward_model, seed: int) -> list[np.ndarray]:
        envs = TaskVectorEnv("match_regions", num_envs=5, reward_model=reward_model)
        first, _ = envs.reset(seed=seed)
        return [first, envs.step(np.ones((5, 3)))[1], envs.step(np.ones((5, 3)))[1]]

    before = run(model, 0)
    count = len(traces)
    farther = replace(model, kappa=2 * model.kappa, card=replace(model.card, source="elsewhere"))
    after = run(farther, 2**40 + 1)
    assert len(traces) == count == 3  # reset once, a step twice
    assert not np.allclose(before[0], after[0]) and (after[1] < before[1]).all()


def test_a_seed_repeats_and_environments_differ(carry):
    envs = TaskVectorEnv("carry", num_envs=4)
    unseeded, _ = envs.reset()
    first, _ = envs.reset(seed=11)
    second, _ = envs.reset()
    np.testing.assert_array_equal(envs.reset(seed=11)[0], first)
    np.testing.assert_array_equal(envs.reset()[0], second)
    assert len(np.unique(np.concatenate([unseeded, first, second]), axis=0)) == 12
    np.testing.assert_array_equal(envs.reset(seed=12)[0][:3], first[1:])


def test_what_it_returns_is_the_callers(carry):
    envs = TaskVectorEnv("carry", num_envs=2)
    observations, infos = envs.reset(seed=0)
    kept = jax.tree.map(np.copy, (observations, infos))
    after = envs.step(np.ones((2, 2)))
    for leaf in jax.tree.leaves((after[0], after[-1])):
        leaf[...] = 0
    assert data_equivalence((observations, infos), kept, exact=True)


def test_gymnasiums_wrappers_sum_up_an_episode(carry):
    envs = RecordEpisodeStatistics(gymnasium.make_vec(carry, num_envs=2))
    envs.reset(seed=0)
    rewards = np.zeros(2)
    for _ in range(30):
        _, reward, *_, infos = envs.step(np.ones((2, 2)))
        rewards += reward
    np.testing.assert_allclose(infos["episode"]["r"], rewards)
    np.testing.assert_array_equal(infos["episode"]["l"], 30)


def test_every_environment_is_drawn(carry):
    envs = TaskVectorEnv("carry", num_envs=3, render_mode="rgb_array")
    with pytest.raises(ResetNeeded, match="render needs a reset before"):
        envs.render()
    observations, _ = envs.reset(seed=0)
    drawn = envs.render()
    for image, observation in zip(drawn, observations, strict=True):
        rows, columns = np.nonzero((image == (0, 128, 0)).all(axis=-1))
        np.testing.assert_allclose([columns.mean() / 64, rows.mean() / 64], observation[2:4], atol=1 / 64)
    assert TaskVectorEnv("carry").render() is None


def test_what_cannot_be_is_refused(carry):
    with pytest.raises(ValueError, match="num_envs is 0; allowed: 1 or more"):
        TaskVectorEnv("carry", num_envs=0)
    with pytest.raises(ValueError, match="max_episode_steps is 0; allowed: 1 or more"):
        TaskVectorEnv("carry", max_episode_steps=0)
    envs = TaskVectorEnv("carry", num_envs=2)
    with pytest.raises(ResetNeeded, match="step needs a reset before"):
        envs.step(np.zeros((2, 2)))
    envs.reset()
    with pytest.raises(ValueError, match=r"step takes actions of shape \(2, 2\), got \(2,\)"):
        envs.step(np.zeros(2))
    with pytest.raises(ValueError, match="reset got the options reset_mask; allowed: none"):
        envs.reset(options={"reset_mask": np.array([True, False])})
