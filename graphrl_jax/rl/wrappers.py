"""Environment wrappers: observe activity, replace the reward, limit the episode, reset automatically.

Every wrapper is written for ONE environment; `vectorise` applies `jax.vmap` outside of them. The order is

    task -> EnvironmentReward, GraphReward or ImageReward -> Episode -> AutoReset -> vmap

Values that a wrapper keeps between steps are in `State.info` and are replaced at every reset. `State.metrics` holds the
scalars of the last step; `AutoReset` copies them to `info["step_metrics"]` for the training loop.
Symbols (N node slots) are those of `graphrl_jax.graph`.
"""

from typing import Any

import jax
import jax.numpy as jnp
from brax.envs.base import Env, State, Wrapper
from brax.envs.wrappers.training import VmapWrapper

from graphrl_jax.encoder.encoder import Seen
from graphrl_jax.graph import build_graph, update_activity
from graphrl_jax.reward.model import RewardModel


class EnvironmentReward(Wrapper):
    """Keeps the task's own reward and adds activity flags to the observation.

    `info` holds the inputs of the next step:

    | field  | shape  | dtype   | meaning                                                                     |
    |--------|--------|---------|-----------------------------------------------------------------------------|
    | boxes  | (N, 4) | float32 | boxes of the last frame                                                     |
    | mask   | (N,)   | bool    | slots that are filled in that frame                                         |
    | active | (N,)   | bool    | slots that have moved in this episode, or counted as moved at its start     |

    The observation is the task's, followed by the N activity flags as 0 or 1. Metric: `env_reward`.

    Args:
      env: the task, a Brax environment with `boxes(state) -> ((N, 4), (N,))` and `objects`.
      tau: scalar activity threshold, in box diagonals per step.
      persistent: see `graph.update_activity`.
    """

    def __init__(self, env: Env, tau: jax.Array | float, persistent: bool = True):
        super().__init__(env)
        self.tau = tau
        self.persistent = persistent

    @property
    def observation_size(self) -> int:
        return self.env.observation_size + self.env.objects.num_slots

    def reset(self, rng: jax.Array) -> State:
        state = self.env.reset(rng)
        boxes, mask = self.env.boxes(state)
        active = state.info.get("active", jnp.zeros(mask.shape, bool))
        return self._with_activity(state, {}, boxes, mask, active)

    def step(self, state: State, action: jax.Array) -> State:
        before = state.info
        state = self.env.step(state, action)
        boxes, mask = self.env.boxes(state)
        last = (before["active"], before["boxes"], before["mask"])
        active = update_activity(*last, boxes, mask, self.tau, self.persistent)
        return self._with_activity(state, before, boxes, mask, active)

    def _with_activity(
        self, state: State, info: dict[str, Any], boxes: jax.Array, mask: jax.Array, active: jax.Array
    ) -> State:
        return state.replace(
            obs=jnp.concatenate([state.obs, active.astype(jnp.float32)]),
            info={**info, **state.info, "boxes": boxes, "mask": mask, "active": active},
            metrics={**state.metrics, "env_reward": state.reward},
        )


class GraphReward(EnvironmentReward):
    """Replaces the task's reward by the learned one, r = -(kappa ||phi(G) - g||)^exponent of the graph after the step.

    Observation and `info` are those of `EnvironmentReward`, so the two settings differ only in the reward. If activity
    does not persist (an ablation), the flags in the observation do not persist either.
    Metrics: `env_reward`, `learned_reward` and `distance` (||phi(G) - g||). A reset has reward 0 and runs no encoder.

    Args:
      env: the task, as for `EnvironmentReward`.
      model: the learned reward, usually traced, so that a new encoder needs no recompilation.
    """

    def __init__(self, env: Env, model: RewardModel):
        super().__init__(env, model.pooling.tau, model.pooling.persistent)
        self.model = model

    def reset(self, rng: jax.Array) -> State:
        state = super().reset(rng)
        return self._with_reward(state, jnp.zeros(()), jnp.zeros(()))

    def step(self, state: State, action: jax.Array) -> State:
        state = super().step(state, action)
        distance = self.model.distance(self._see(state))
        return self._with_reward(state, self.model.value(distance), distance)

    def _see(self, state: State) -> Seen:
        """The encoder's input for a state."""
        info = state.info
        return build_graph(self.env.objects, info["boxes"], info["mask"], info["active"], info.get("class_ids"))

    def _with_reward(self, state: State, reward: jax.Array, distance: jax.Array) -> State:
        metrics = {**state.metrics, "learned_reward": reward, "distance": distance}
        return state.replace(reward=reward, metrics=metrics)


class ImageReward(GraphReward):
    """As `GraphReward`, but of the image after the step, which the task draws (XIRL)."""

    def _see(self, state: State) -> Seen:
        return self.env.image(state.pipeline_state, self.model.image_size)


WRAPPERS: dict[str, type[EnvironmentReward]] = {
    "nothing": EnvironmentReward,
    "graphs": GraphReward,
    "images": ImageReward,
}
"""Reward wrappers by the input of the reward (`methods.Needs`)."""


class Episode(Wrapper):
    """Ends the episode after `episode_length` steps and sums its reward.

    Brax's own wrapper sizes its counters by `rng.shape[:-1]`, which is wrong for typed keys; this one is unbatched.

    `info`: `steps` () int32, `truncation` () float32 (1 if only the time limit ended the episode), `episode_return` ()
    float32. Metrics: `episode_return` and `episode_length`, complete at the step with done = 1.
    """

    def __init__(self, env: Env, episode_length: int):
        super().__init__(env)
        self.episode_length = episode_length

    def reset(self, rng: jax.Array) -> State:
        state = self.env.reset(rng)
        zero = jnp.zeros((), jnp.float32)
        return self._with_counters(state, {}, jnp.zeros((), jnp.int32), zero, zero)

    def step(self, state: State, action: jax.Array) -> State:
        before = state.info
        state = self.env.step(state, action)
        steps = before["steps"] + 1
        out_of_time = (steps >= self.episode_length).astype(jnp.float32)
        done = jnp.asarray(state.done, jnp.float32)
        state = state.replace(done=jnp.maximum(done, out_of_time))
        return self._with_counters(
            state, before, steps, out_of_time * (1.0 - done), before["episode_return"] + state.reward
        )

    def _with_counters(
        self, state: State, info: dict[str, Any], steps: jax.Array, truncation: jax.Array, episode_return: jax.Array
    ) -> State:
        counters = {"steps": steps, "truncation": truncation, "episode_return": episode_return}
        outcome = {"episode_return": episode_return, "episode_length": steps.astype(jnp.float32)}
        return state.replace(info={**info, **state.info, **counters}, metrics={**state.metrics, **outcome})


class AutoReset(Wrapper):
    """Starts a new episode as soon as one is done.

    Brax's own wrapper replays one cached first state and does not change `info`. Here every reset draws a new state
    with a key from `info["reset_key"]`, and physics state, observation and `info` are those of the new episode. The
    results of the last step remain: `reward`, `done`, `metrics` and `info["truncation"]`. At done = 1 the metrics are
    therefore those of the finished episode's last state. `info["step_metrics"]` is a copy of them.

    A new state is computed at every step and mostly discarded (a batched branch computes both sides), so the reset of
    the wrapped environment has to be cheap.
    """

    def reset(self, rng: jax.Array) -> State:
        reset_key, first_key = jax.random.split(rng)
        state = self.env.reset(first_key)
        info = {**state.info, "reset_key": reset_key, "step_metrics": state.metrics}
        return state.replace(info=info)

    def step(self, state: State, action: jax.Array) -> State:
        reset_key, fresh_key = jax.random.split(state.info["reset_key"])
        # A task may leave `done` unchanged.
        state = self.env.step(state.replace(done=jnp.zeros_like(state.done)), action)
        fresh = self.env.reset(fresh_key)

        def choose(new: Any, old: Any) -> Any:
            return jax.tree.map(lambda a, b: jnp.where(state.done > 0, a, b), new, old)

        info = choose(fresh.info, {name: state.info[name] for name in fresh.info})
        kept = {"reset_key": reset_key, "truncation": state.info["truncation"], "step_metrics": state.metrics}
        return state.replace(
            pipeline_state=choose(fresh.pipeline_state, state.pipeline_state),
            obs=choose(fresh.obs, state.obs),
            info={**info, **kept},
        )


def vectorise(env: Env, episode_length: int) -> Wrapper:
    """The environment for a training loop: with time limit, automatic reset and batch axis.

    `reset` takes keys (B,) and `step` a batched state and actions (B, A).
    """
    return VmapWrapper(AutoReset(Episode(env, episode_length)))


def stagger(state: State, key: jax.Array, episode_length: int) -> State:
    """Draws a random step count for each environment, so that a batch of new episodes does not end all at once.

    Meant for the first reset of a training run: its first episodes are cut short, later ones are whole.
    """
    steps = state.info["steps"]
    drawn = jax.random.randint(key, steps.shape, 0, episode_length, dtype=steps.dtype)
    return state.replace(info={**state.info, "steps": drawn})
