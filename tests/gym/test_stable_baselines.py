"""Vector environments as Stable-Baselines3 takes them."""

import importlib
import re

import gymnasium
import numpy as np
import pytest

from graphrl_jax.gym import TaskVectorEnv
from tests.helpers.outside_package import REPOSITORY


@pytest.fixture(scope="module")
def stable_baselines():
    pytest.importorskip("stable_baselines3", exc_type=ImportError)
    return importlib.import_module("graphrl_jax.gym.stable_baselines")


def test_without_the_package_one_sentence_names_the_extra(monkeypatch):
    monkeypatch.setitem(importlib.import_module("sys").modules, "stable_baselines3", None)
    monkeypatch.delitem(importlib.import_module("sys").modules, "graphrl_jax.gym.stable_baselines", raising=False)
    with pytest.raises(ImportError, match=r"needs the package stable_baselines3: pip install .graphrl_jax\[sb3\]"):
        importlib.import_module("graphrl_jax.gym.stable_baselines")


def test_steps_are_the_vector_environments_and_ends_are_told(carry, stable_baselines):
    ours, plain = stable_baselines.StableBaselinesVecEnv(TaskVectorEnv("carry", 2)), TaskVectorEnv("carry", 2)
    ours.seed(4)
    np.testing.assert_array_equal(ours.reset(), plain.reset(seed=4)[0])
    for step in range(31):
        actions = np.full((2, 2), 0.1 * step, np.float32)
        observations, rewards, done, told = ours.step(actions)
        expected, paid, _, truncations, infos = plain.step(actions)
        np.testing.assert_array_equal(observations, expected)
        np.testing.assert_allclose(rewards, paid, rtol=1e-6)
        np.testing.assert_array_equal(done, truncations)
        assert rewards.dtype == np.float32
        if step != 29:
            assert told == [{}, {}]
            continue
        for index, one in enumerate(told):
            assert one["TimeLimit.truncated"] is True
            assert one["is_success"] == infos["final_info"]["success"][index]
            np.testing.assert_array_equal(one["terminal_observation"], infos["final_obs"][index])
            np.testing.assert_array_equal(one["boxes"], infos["final_info"]["boxes"][index])
    np.testing.assert_array_equal(ours.reset(), plain.reset()[0])


def test_it_has_what_the_interface_asks_for(carry, stable_baselines):
    ours = stable_baselines.StableBaselinesVecEnv(TaskVectorEnv("carry", 3, render_mode="rgb_array"))
    assert ours.num_envs == 3 and ours.observation_space.shape == (7,) and ours.action_space.shape == (2,)
    assert ours.get_attr("render_mode") == ["rgb_array"] * 3 and ours.get_attr("num_envs", [0]) == [3]
    assert ours.env_is_wrapped(gymnasium.Wrapper) == [False] * 3
    ours.reset()
    assert [image.shape for image in ours.get_images()] == [(64, 64, 3)] * 3
    with pytest.raises(AttributeError, match="have no methods of their own, such as 'action_masks'"):
        ours.env_method("action_masks")
    envs = gymnasium.vector.SyncVectorEnv([lambda: gymnasium.make(carry)])
    with pytest.raises(ValueError, match="autoreset_mode is AutoresetMode.NEXT_STEP; allowed: AutoresetMode.SAME_STEP"):
        stable_baselines.StableBaselinesVecEnv(envs)


def test_the_example_of_the_documents_runs(stable_baselines, monkeypatch):
    monkeypatch.chdir(REPOSITORY)
    page = (REPOSITORY / "docs" / "gymnasium.md").read_text()
    block = re.findall(r"^```python\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)[-1]
    for size, small in (("1_000_000", "8"), ("num_envs=128", "num_envs=2"), ("n_steps=120", "n_steps=4"), ("960", "8")):
        assert size in block
        block = block.replace(size, small)
    names: dict = {"gymnasium": gymnasium}
    exec(compile(block, "gymnasium.md", "exec"), names)
    assert names["ppo"].num_timesteps == 8
