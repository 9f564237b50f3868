"""A task as a Gymnasium environment."""

from pathlib import Path
from typing import Any

import gymnasium
import jax
import numpy as np
from brax.envs.base import State
from gymnasium.error import ResetNeeded
from gymnasium.spaces import Box

from graphrl_jax.gym.simulation import Frame, Simulation, make_simulation
from graphrl_jax.reward.model import RewardModel
from graphrl_jax.rl.wrappers import MOST

RENDER_MODES = ["rgb_array"]


class TaskEnv(gymnasium.Env):
    """One environment of a task. A step is a control step, and `metadata["render_fps"]` their number per second.

    The observation (O,) float32 is what the policies of this package observe: the task's, and a flag for each object
    that has moved. Actions are (A,) float32 in [-1, 1]; others are clipped. An episode does not end at success, but is
    truncated after `Task.episode_length` steps, or earlier if the physics diverges.

    `info` of reset and step:

    | entry              | shape  | type    | meaning                                                          |
    |--------------------|--------|---------|------------------------------------------------------------------|
    | success            |        | bool    | the task is solved in this state                                 |
    | score              |        | float   | how far it is solved, 0 to 1                                     |
    | environment_reward |        | float   | the task's own reward of the step                                |
    | events             | (E,)   | bool    | the task's events that are reached in this state                 |
    | boxes              | (N, 4) | float32 | boxes of the task's objects, cx, cy, w, h in units of the image  |
    | mask               | (N,)   | bool    | objects that are seen                                            |
    | active             | (N,)   | bool    | objects that have moved in this episode                          |

    The start of the k-th episode after `reset(seed)` depends on the seed and k alone.

    Args:
      task: registered name.
      reward_model: pays the reward of this model of the task's objects, or of the one in this folder (Eq. 3); None: the
        task's own reward.
      engine: name of the physics engine; None takes the fastest on this device.
      training: draw the starts of policy training, many of which are nearer to the goal. Shoes in Box computes its
        starts when the environment is made, which takes minutes.
      render_mode: `rgb_array` or None.

    Raises:
      ValueError: see `make_simulation`, or the mode is unknown.
    """

    metadata: dict[str, Any] = {"render_modes": RENDER_MODES}

    def __init__(
        self,
        task: str,
        reward_model: RewardModel | str | Path | None = None,
        engine: str | None = None,
        training: bool = False,
        render_mode: str | None = None,
    ):
        refuse_unknown_mode(render_mode)
        self._simulation = make_simulation(task, reward_model, engine, training)
        self.task = self._simulation.task
        self.observation_space, self.action_space = spaces_of(self._simulation)
        self.metadata = {**self.metadata, "render_fps": self.task.frame_rate}
        self.render_mode = render_mode
        self._state: State | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """The first observation of the next episode, or of the first one of a seed, and its `info`."""
        super().reset(seed=seed)
        refuse_options(options)
        self._state, frame = next_episodes(self._simulation, self._state, 1, seed, self.np_random)
        return frame.obs[0], _info(frame)

    def step(self, action: Any) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Observation, reward, terminated, truncated and `info` after one control step.

        Raises:
          ResetNeeded: the environment has not been reset yet.
          ValueError: the action has another shape.
        """
        if self._state is None:
            raise ResetNeeded("step needs a reset before")
        actions = checked_actions(action, self.action_space.shape)[None]
        self._state, frame = self._simulation.advance(self._state, actions)
        return (
            frame.obs[0],
            frame.reward[0].item(),
            frame.terminated[0].item(),
            frame.truncated[0].item(),
            _info(frame),
        )

    def render(self) -> np.ndarray | None:
        """The task's drawing of the present state, (H, W, 3) uint8; None without a render mode.

        Raises:
          ResetNeeded: the environment has not been reset yet.
        """
        return None if self.render_mode is None else drawings(self._simulation, self._state)[0]


def _info(frame: Frame) -> dict[str, Any]:
    """What `TaskEnv` tells of the only environment of a frame."""
    return {name: leaf[0] if leaf.ndim > 1 else leaf[0].item() for name, leaf in frame.info.items()}


def spaces_of(simulation: Simulation) -> tuple[Box, Box]:
    """Spaces of the observation and of the action of one environment."""
    return (
        Box(-MOST, MOST, (simulation.observation_size,), np.float32),
        Box(-1.0, 1.0, (simulation.task.action_size,), np.float32),
    )


def seeds_of(seed: int, count: int) -> np.ndarray:
    """Seeds of `count` environments: (count,) uint32; as in Gymnasium, the i-th one has the seed `seed` + i."""
    return ((int(seed) % 2**32 + np.arange(count)) % 2**32).astype(np.uint32)


def next_episodes(
    simulation: Simulation, state: State | None, count: int, seed: int | None, random: np.random.Generator
) -> tuple[State, Frame]:
    """First states of `count` environments, of a seed if one is given, else of the episodes after those of `state`.

    Without either, as at the first reset, a seed is drawn from `random`.
    """
    if state is not None and seed is None:
        return simulation.renew(state)
    return simulation.begin(seeds_of(random.integers(2**31) if seed is None else seed, count))


def checked_actions(actions: Any, shape: tuple[int, ...]) -> np.ndarray:
    """Actions as float32.

    Raises:
      ValueError: their shape is another one.
    """
    found = np.asarray(actions, np.float32)
    if found.shape != shape:
        raise ValueError(f"step takes actions of shape {shape}, got {found.shape}")
    return found


def refuse_options(options: dict[str, Any] | None) -> None:
    """Checks that a reset is asked for nothing that it does not know.

    Raises:
      ValueError: it is.
    """
    if options:
        raise ValueError(f"reset got the options {', '.join(options)}; allowed: none")


def refuse_unknown_mode(render_mode: str | None) -> None:
    """Checks the render mode.

    Raises:
      ValueError: it is unknown.
    """
    if render_mode is not None and render_mode not in RENDER_MODES:
        raise ValueError(f"render_mode is {render_mode!r}; allowed: {', '.join(RENDER_MODES)}, or None")


def drawings(simulation: Simulation, state: State | None) -> list[np.ndarray]:
    """The task's drawing of every environment's state, each (H, W, 3) uint8.

    Raises:
      ResetNeeded: there is no state yet.
    """
    if state is None:
        raise ResetNeeded("render needs a reset before")
    physics = jax.tree.map(np.asarray, state.pipeline_state)
    count = len(state.done)
    return [simulation.task.draw(jax.tree.map(lambda leaf, i=i: leaf[i], physics)) for i in range(count)]
