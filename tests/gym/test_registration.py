"""Every task has an identifier, with which Gymnasium makes one environment or many."""

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from graphrl_jax.gym import TaskEnv, TaskVectorEnv, register_tasks
from graphrl_jax.gym.registration import identifier_of
from graphrl_jax.registry import task_names


def test_every_task_is_registered_once():
    assert identifier_of("match_regions") == "graphrl/MatchRegions-v0"
    assert identifier_of("shoes_in_box") == "graphrl/ShoesInBox-v0"
    assert {identifier_of(name) for name in task_names()} <= gymnasium.registry.keys()
    before = dict(gymnasium.registry)
    register_tasks()
    assert gymnasium.registry == before


@pytest.mark.parametrize("prefix", ["", "graphrl_jax.gym:"])
def test_gymnasium_makes_one_environment(prefix):
    env = gymnasium.make(f"{prefix}graphrl/ShoesInBox-v0", render_mode="rgb_array")
    assert isinstance(env.unwrapped, TaskEnv) and env.unwrapped.task.name == "shoes_in_box"
    assert env.metadata["render_fps"] == env.unwrapped.task.frame_rate == pytest.approx(20)


def test_gymnasium_makes_many_environments_in_one_program():
    envs = gymnasium.make_vec("graphrl/MatchRegions-v0", num_envs=8)
    assert isinstance(envs.unwrapped, TaskVectorEnv)
    assert envs.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    observations, infos = envs.reset(seed=0)
    assert observations in envs.observation_space and envs.num_envs == 8
    assert infos["boxes"].shape == (8, 8, 4) and not infos["success"].any()
    observations, rewards, terminations, truncations, _ = envs.step(envs.action_space.sample())
    assert observations in envs.observation_space and np.isfinite(rewards).all()
    assert not terminations.any() and not truncations.any()


def test_gymnasium_cuts_episodes_off_in_both_ways(carry):
    one = gymnasium.make(carry, max_episode_steps=3)
    many = gymnasium.make_vec(carry, num_envs=2, max_episode_steps=3)
    one.reset(seed=0), many.reset(seed=0)
    for step in range(3):
        truncated, truncations = one.step(np.zeros(2))[3], many.step(np.zeros((2, 2)))[3]
        assert truncated == (step == 2) and (truncations == truncated).all()


def test_gymnasiums_own_vector_environment_takes_ours(carry):
    envs = gymnasium.make_vec(carry, num_envs=2, vectorization_mode="sync")
    assert isinstance(envs, SyncVectorEnv)
    assert envs.reset(seed=0)[0].shape == (2, 7)
