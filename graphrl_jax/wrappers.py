"""Environment wrappers: observe activity, replace the reward, limit the episode, reset automatically.

Every wrapper is written for ONE environment; `vectorise` applies `jax.vmap` at the edge. The order is

    task -> EnvironmentReward, GraphReward or PixelReward -> Episode -> AutoReset -> vmap

Whatever a wrapper remembers between steps lives in `State.info` and is replaced at every reset. `State.metrics` holds
the scalars of the step just made; `AutoReset` copies them to `info["step_metrics"]`, where a training loop finds them.
Symbols (N node slots) are those of `graphrl_jax.graph`.
"""

from typing import Any

import jax
import jax.numpy as jnp
from brax.envs.base import Env, State, Wrapper
from brax.envs.wrappers.training import VmapWrapper

from graphrl_jax.encoder import Seen
from graphrl_jax.graph import build_graph, update_activity
from graphrl_jax.reward import RewardModel


class EnvironmentReward(Wrapper):
    """Keeps the task's own reward and shows the policy which objects have been moved.

    `info` holds what the next step needs:

    ========  =======  ===================================================
    boxes     (N, 4)   float32, boxes of the last frame
    mask      (N,)     bool, which slots that frame filled
    active    (N,)     bool, which slots have moved since the episode began, or counted as moved then
    ========  =======  ===================================================

    The observation is the task's, followed by the N activity flags as 0 or 1. Metric: `env_reward`.

    Args:
        env: the task: a Brax environment with `boxes(state) -> ((N, 4), (N,))` and `objects`.
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

    Observation and `info` are those of `EnvironmentReward`, so the two settings differ in the reward alone; where
    activity does not persist (an ablation), the policy sees it so as well.
    Metrics: `env_reward`, `learned_reward` and `distance` (||phi(G) - g||). A reset costs no encoding: its reward is 0.

    Args:
        env: the task, as for `EnvironmentReward`.
        model: the learned reward, usually traced, so that another encoder compiles nothing.
    """

    def __init__(self, env: Env, model: RewardModel):
        super().__init__(env, model.tau, model.persistent)
        self.model = model

    def reset(self, rng: jax.Array) -> State:
        state = super().reset(rng)
        return self._with_reward(state, jnp.zeros(()), jnp.zeros(()))

    def step(self, state: State, action: jax.Array) -> State:
        state = super().step(state, action)
        distance = self.model.distance(self._see(state))
        return self._with_reward(state, self.model.value(distance), distance)

    def _see(self, state: State) -> Seen:
        """What the encoder is shown of a state."""
        info = state.info
        return build_graph(self.env.objects, info["boxes"], info["mask"], info["active"], info.get("class_ids"))

    def _with_reward(self, state: State, reward: jax.Array, distance: jax.Array) -> State:
        metrics = {**state.metrics, "learned_reward": reward, "distance": distance}
        return state.replace(reward=reward, metrics=metrics)


class PixelReward(GraphReward):
    """XIRL's way: as `GraphReward`, of the picture after the step, which the task draws."""

    def _see(self, state: State) -> Seen:
        return self.env.picture(state.pipeline_state, self.model.picture_size)


class Episode(Wrapper):
    """Ends the episode after `episode_length` steps and sums its reward.

    Brax's own wrapper sizes its counters by `rng.shape[:-1]`, which is wrong for typed keys; this one is unbatched.

    `info`: `steps` () int32, `truncation` () float32 (1 when the time limit, and nothing else, ended the episode),
    `episode_return` () float32. Metrics: `episode_return` and `episode_length`, complete at the step with done = 1.
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
    """Starts a fresh episode as soon as one is done.

    Brax's own wrapper replays one cached first state and leaves `info` alone; here every reset draws a new state from
    a key carried in `info["reset_key"]`, and physics state, observation and all of `info` are the new episode's.
    What belongs to the step just made stays: `reward`, `done`, `metrics` and `info["truncation"]`. At done = 1 the
    metrics are therefore those of the finished episode's last state. `info["step_metrics"]` repeats them.

    A fresh state is computed at every step and mostly thrown away (a batched branch computes both sides), so the
    wrapped environment's reset has to be cheap.
    """

    def reset(self, rng: jax.Array) -> State:
        reset_key, first_key = jax.random.split(rng)
        state = self.env.reset(first_key)
        info = {**state.info, "reset_key": reset_key, "step_metrics": state.metrics}
        return state.replace(info=info)

    def step(self, state: State, action: jax.Array) -> State:
        reset_key, fresh_key = jax.random.split(state.info["reset_key"])
        # A task may leave `done` as it finds it.
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
    """The environment as a training loop wants it: time-limited, resetting itself, batched.

    `reset` takes keys (B,) and `step` a batched state and actions (B, A).
    """
    return VmapWrapper(AutoReset(Episode(env, episode_length)))


def stagger(state: State, key: jax.Array, episode_length: int) -> State:
    """Draws each environment's step count, so that a batch of new episodes does not end all at once.

    Meant for the very first reset of a training run: its first episodes are cut short, later ones are whole.
    """
    steps = state.info["steps"]
    drawn = jax.random.randint(key, steps.shape, 0, episode_length, dtype=steps.dtype)
    return state.replace(info={**state.info, "steps": drawn})
