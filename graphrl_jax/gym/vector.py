"""A task as a Gymnasium vector environment: one compiled program steps all of its environments."""

from pathlib import Path
from typing import Any

import numpy as np
from brax.envs.base import State
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from graphrl_jax.gym.environment import (
    RENDER_MODES,
    checked_actions,
    drawings,
    next_episodes,
    refuse_options,
    refuse_unknown_mode,
    spaces_of,
)
from graphrl_jax.gym.simulation import Frame, make_simulation
from graphrl_jax.reward.model import RewardModel


class TaskVectorEnv(VectorEnv):
    """B environments of a task; see `TaskEnv` for observation, action, end of an episode and `info`.

    A step that ends an episode also begins the next one (`AutoresetMode.SAME_STEP`): its observation and `infos` are
    those of the new start, and the end's are in `infos`:

    | entry      | meaning                                                                       |
    |------------|-------------------------------------------------------------------------------|
    | final_obs  | (B,) object, the last observation (O,) where an episode has ended or None |
    | final_info | the last `info`, arrays (B, ...) that are 0 where no episode has ended        |

    Both are there only if an episode has ended. Every entry has a mask (B,) bool of the same name after an underscore.
    The i-th environment with the seed s does what a `TaskEnv` with the seed s + i does.

    Args:
      task: registered name.
      num_envs: B.
      reward_model, engine, training, render_mode: see `TaskEnv`.
      max_episode_steps: an episode is truncated after so many steps, if the task does not do so before.

    Raises:
      ValueError: see `make_simulation`, or there is no environment, or the mode is unknown.
    """

    def __init__(
        self,
        task: str,
        num_envs: int = 1,
        reward_model: RewardModel | str | Path | None = None,
        engine: str | None = None,
        training: bool = False,
        render_mode: str | None = None,
        max_episode_steps: int | None = None,
    ):
        refuse_unknown_mode(render_mode)
        if num_envs < 1:
            raise ValueError(f"num_envs is {num_envs}; allowed: 1 or more")
        self._simulation = make_simulation(task, reward_model, engine, training, max_episode_steps)
        self.task = self._simulation.task
        self.num_envs = num_envs
        self.single_observation_space, self.single_action_space = spaces_of(self._simulation)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.metadata = {
            "render_modes": RENDER_MODES,
            "render_fps": self.task.frame_rate,
            "autoreset_mode": AutoresetMode.SAME_STEP,
        }
        self.render_mode = render_mode
        self._state: State | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """The first observations (B, O) of the next episodes, or of the first ones of a seed, and their `infos`."""
        super().reset(seed=seed)
        refuse_options(options)
        self._state, frame = next_episodes(self._simulation, self._state, self.num_envs, seed, self.np_random)
        return frame.obs, _infos(frame, np.ones(self.num_envs, bool))

    def step(self, actions: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Observations, rewards (B,) float64, terminations, truncations (B,) bool, and `infos` after one control step.

        Raises:
          ResetNeeded: the environments have not been reset yet.
          ValueError: the actions have another shape.
        """
        if self._state is None:
            raise ResetNeeded("step needs a reset before")
        checked = checked_actions(actions, self.action_space.shape)
        self._state, last, frame = self._simulation.advance_and_renew(self._state, checked)
        infos = {**_infos(frame, np.ones(self.num_envs, bool)), **_final(last)}
        return frame.obs, last.reward.astype(np.float64), last.terminated, last.truncated, infos

    def render(self) -> tuple[np.ndarray, ...] | None:
        """The task's drawings of the present states, each (H, W, 3) uint8; None without a render mode.

        Raises:
          ResetNeeded: the environments have not been reset yet.
        """
        return None if self.render_mode is None else tuple(drawings(self._simulation, self._state))


def _infos(frame: Frame, told: np.ndarray) -> dict[str, Any]:
    """The info of the environments `told` (B,) bool as Gymnasium batches it: arrays, each with a mask."""
    infos = {}
    for name, leaf in frame.info.items():
        # What is a float of one environment is float64 for Gymnasium.
        kind = np.float64 if leaf.ndim == 1 and leaf.dtype == np.float32 else leaf.dtype
        kept = told.reshape(-1, *[1] * (leaf.ndim - 1))
        infos |= {name: np.where(kept, leaf, 0).astype(kind), f"_{name}": told.copy()}
    return infos


def _final(last: Frame) -> dict[str, Any]:
    """What Gymnasium tells of the ends of episodes; nothing if none has ended."""
    ended = last.terminated | last.truncated
    if not ended.any():
        return {}
    observations = np.full(len(ended), None, object)
    for index in np.flatnonzero(ended):
        observations[index] = last.obs[index]
    return {
        "final_obs": observations,
        "_final_obs": ended.copy(),
        "final_info": _infos(last, ended),
        "_final_info": ended.copy(),
    }
