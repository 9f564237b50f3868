"""A Gymnasium vector environment for Stable-Baselines3. Needs the package extra `sb3`."""

from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv

from graphrl_jax.gym.optional import require

require("stable_baselines3", "sb3")

from stable_baselines3.common.vec_env import VecEnv  # noqa: E402  # pyright: ignore[reportMissingImports]


class StableBaselinesVecEnv(VecEnv):
    """A vector environment with `AutoresetMode.SAME_STEP`, such as `TaskVectorEnv`, as Stable-Baselines3 takes it.

    The `infos` of a step are empty but for the environments whose episode has ended: they have `terminal_observation`
    and `TimeLimit.truncated`, `is_success` if the environment tells a `success`, and the entries of `final_info`.

    Args:
      env: the environment.

    Raises:
      ValueError: the environment begins episodes anew in another way.
    """

    def __init__(self, env: VectorEnv):
        mode = env.metadata.get("autoreset_mode")
        if mode is not AutoresetMode.SAME_STEP:
            raise ValueError(f"the environment's autoreset_mode is {mode}; allowed: {AutoresetMode.SAME_STEP}")
        self.env = env
        self._actions: Any = None
        super().__init__(env.num_envs, env.single_observation_space, env.single_action_space)

    def reset(self) -> np.ndarray:
        """The first observations (B, O) of the next episodes, or of the first ones of the seed given by `seed`."""
        observations, _ = self.env.reset(seed=self._seeds[0])
        self._reset_seeds()
        return observations

    def step_async(self, actions: np.ndarray) -> None:
        self._actions = actions

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """Observations, rewards (B,) float32, ends of episodes (B,) bool, and what is told of each environment."""
        observations, rewards, terminations, truncations, infos = self.env.step(self._actions)
        done = terminations | truncations
        told: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for index in np.flatnonzero(done):
            final = {name: values[index] for name, values in infos["final_info"].items() if f"_{name}" in infos}
            if "success" in final:
                final["is_success"] = final["success"]
            told[index] = {
                **final,
                "terminal_observation": infos["final_obs"][index],
                "TimeLimit.truncated": bool(truncations[index] and not terminations[index]),
            }
        return observations, rewards.astype(np.float32), done, told

    def close(self) -> None:
        self.env.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """An attribute of the vector environment, once for each of its environments."""
        return [getattr(self.env, attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Sets an attribute of the vector environment."""
        setattr(self.env, attr_name, value)

    def env_method(self, method_name: str, *method_args: Any, indices: Any = None, **method_kwargs: Any) -> list[Any]:
        """Not to be had.

        Raises:
          AttributeError: always, because environments of one program have no methods of their own.
        """
        raise AttributeError(f"environments of one program have no methods of their own, such as {method_name!r}")

    def env_is_wrapped(self, wrapper_class: type, indices: Any = None) -> list[bool]:
        """Single environments have no wrappers."""
        return [False for _ in self._get_indices(indices)]

    def get_images(self) -> list[np.ndarray]:
        """The drawing of every environment; none without a render mode."""
        return list(self.env.render() or ())
