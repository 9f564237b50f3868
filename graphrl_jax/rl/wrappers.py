"""Environment wrappers: observe activity, replace the reward, limit the episode, decide seldom, reset automatically.

Every wrapper is written for ONE environment; `batch.vectorise` puts them together and applies `jax.vmap` outside of
them. The order is

    task -> EnvironmentReward, GraphReward or ImageReward -> Nodes -> Episode -> Progress -> Decisions -> AutoReset
    -> Batch

Values that a wrapper keeps between steps are in `State.info` and are replaced at every reset. `State.metrics` holds the
scalars of the last step; `AutoReset` copies them to `info["step_metrics"]` for the training loop.
Symbols (N node slots) are those of `graphrl_jax.graph`.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from brax.envs.base import Env, State, Wrapper

from graphrl_jax.encoder.encoder import Seen
from graphrl_jax.encoder.pooling import PoolingParams
from graphrl_jax.graph import ActivityState, begin_activity, build_graph, update_activity
from graphrl_jax.reward.model import RewardModel
from graphrl_jax.rl.config import PPOConfig

# A reward counts as better than the best one so far if it is higher by this; before the first step, any reward does.
_BETTER = 0.01
_NO_REWARD = float(np.finfo(np.float32).min)

MOST = 1e4
"""Observations and rewards beyond this come from physics that is about to turn NaN, and would spoil statistics."""


class _Wrapper(Wrapper):
    """A wrapper that treats the starts of all episodes alike."""

    def reset(self, rng: jax.Array) -> State:
        return self.begin(self.env.reset(rng))

    def restart(self, rng: jax.Array, last: State) -> State:
        """The start of the next training episode after one that ended in the state `last`."""
        # Environments that are not tasks may have none.
        restart = getattr(self.env, "restart", None)
        return self.begin(restart(rng, last) if restart else self.env.reset(rng))

    def begin(self, state: State) -> State:
        """The start of an episode, with what this wrapper adds."""
        return state


class EnvironmentReward(_Wrapper):
    """Keeps the task's own reward and adds activity flags to the observation.

    `info` holds the last frame and its `ActivityState`, which is the input of the next step:

    | field           | shape  | dtype   | meaning                                                                 |
    |-----------------|--------|---------|-------------------------------------------------------------------------|
    | boxes           | (N, 4) | float32 | boxes of the last frame                                                 |
    | mask            | (N,)   | bool    | slots that are filled in that frame                                     |
    | active          | (N,)   | bool    | slots that have moved in this episode, or counted as moved at its start |
    | reference_boxes | (N, 4) | float32 | see `ActivityState`                                                     |
    | reference_mask  | (N,)   | bool    | see `ActivityState`                                                     |

    The observation is the task's, followed by the N activity flags as 0 or 1. Metric: `env_reward`.

    Args:
      env: the task, a Brax environment with `boxes(state) -> ((N, 4), (N,))` and `objects`.
      pooling: `tau` and `activity` define activity; nothing else of it is used.
    """

    def __init__(self, env: Env, pooling: PoolingParams):
        super().__init__(env)
        self.pooling = pooling

    @property
    def observation_size(self) -> int:
        return self.env.observation_size + self.env.objects.num_slots

    def begin(self, state: State) -> State:
        boxes, mask = self.env.boxes(state)
        activity = begin_activity(boxes, mask, state.info.get("active"))
        return self._with_activity(state, {}, boxes, mask, activity)

    def step(self, state: State, action: jax.Array) -> State:
        before = state.info
        state = self.env.step(state, action)
        boxes, mask = self.env.boxes(state)
        last = ActivityState(*(before[name] for name in ActivityState._fields))
        activity = update_activity(last, boxes, mask, self.pooling.tau, self.pooling.activity)
        return self._with_activity(state, before, boxes, mask, activity)

    def _with_activity(
        self, state: State, info: dict[str, Any], boxes: jax.Array, mask: jax.Array, activity: ActivityState
    ) -> State:
        return state.replace(
            obs=jnp.concatenate([state.obs, activity.active.astype(jnp.float32)]),
            info={**info, **state.info, "boxes": boxes, "mask": mask, **activity._asdict()},
            metrics={**state.metrics, "env_reward": state.reward},
        )


class GraphReward(EnvironmentReward):
    """Replaces the task's reward by the learned one, `RewardModel.value` of the graph after the step.

    Observation and `info` are those of `EnvironmentReward`, so the two settings differ only in the reward. If activity
    does not persist (an ablation), the flags in the observation do not persist either.
    Metrics: `env_reward`, `learned_reward` and `distance` (||phi(G) - g||). A reset has reward 0 and runs no encoder.

    Args:
      env: the task, as for `EnvironmentReward`.
      model: the learned reward, usually traced, so that a new encoder needs no recompilation.
    """

    def __init__(self, env: Env, model: RewardModel):
        super().__init__(env, model.pooling)
        self.model = model

    def begin(self, state: State) -> State:
        return self._with_reward(super().begin(state), jnp.zeros(()), jnp.zeros(()))

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


class Nodes(_Wrapper):
    """Adds the task's objects to the end of the observation, for policies that take them as a set."""

    @property
    def observation_size(self) -> int:
        nodes = jax.eval_shape(lambda key: self.env.nodes(self.env.reset(key)), jax.random.key(0))
        return self.env.observation_size + nodes.size

    def begin(self, state: State) -> State:
        return self._seen(state)

    def step(self, state: State, action: jax.Array) -> State:
        return self._seen(self.env.step(state, action))

    def _seen(self, state: State) -> State:
        return state.replace(obs=jnp.concatenate([state.obs, self.env.nodes(state).ravel()]))


class Episode(_Wrapper):
    """Ends the episode after `episode_length` steps and sums its reward.

    Brax's own wrapper sizes its counters by `rng.shape[:-1]`, which is wrong for typed keys; this one is unbatched.

    `info`: `steps` () int32, `truncation` () float32 (1 if only the time limit ended the episode), `episode_return` ()
    float32. Metrics: `episode_return` and `episode_length`, complete at the step with done = 1.
    """

    def __init__(self, env: Env, episode_length: int):
        super().__init__(env)
        self.episode_length = episode_length

    def begin(self, state: State) -> State:
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


class Progress(_Wrapper):
    """Pays the change of the reward from step to step instead of the reward, and ends an episode without progress.

    The best policies are the same, because up to a factor this is shaping by the potential r(s) / (1 - gamma), the
    value of staying in s (Ng et al., "Policy invariance under reward transformations", 1999):

        r(s') + gamma r(s') / (1 - gamma) - r(s) / (1 - gamma) = (r(s') - r(s)) / (1 - gamma)

    The value network then learns only what changes; otherwise its errors about what stays the same hide what an action
    does. The first step of an episode pays 0, because a reset computes no reward.

    An episode that is stuck or finished teaches little, so it ends. It counts as ended for good and not as cut off:
    what is left to gain is 0, and a value network that learns it only from its own guesses diverges.

    Before such an end the robot may retreat: the task's `retreat_action` replaces the policy's for the last steps. A
    reward that cannot see the robot pays nothing for letting go of an object. But what the robot still holds leaves
    with it, so the policy learns to let go of what it has brought.

    `info`: `last_reward` and `best_reward` () float32; `stuck` () int32, steps since the best reward.

    Args:
      env: an environment with time limit.
      patience: the episode ends after so many steps without a better reward; 0 for never.
      retreat: of these, so many steps at the end are the robot's retreat.
    """

    def __init__(self, env: Env, patience: int = 0, retreat: int = 0):
        super().__init__(env)
        self.patience, self.retreat = patience, retreat

    def begin(self, state: State) -> State:
        return self._remember(state, {}, jnp.zeros(()), jnp.full((), _NO_REWARD), jnp.zeros((), jnp.int32))

    def step(self, state: State, action: jax.Array) -> State:
        before = state.info
        if self.retreat:
            leaves = before["stuck"] >= self.patience - self.retreat
            action = jnp.where(leaves, jnp.asarray(self.env.retreat_action), action)
        state = self.env.step(state, action)
        first = before["best_reward"] == _NO_REWARD
        better = state.reward > before["best_reward"] + _BETTER
        best = jnp.where(better, state.reward, before["best_reward"])
        stuck = jnp.where(better, 0, before["stuck"] + 1)
        change = jnp.where(first, 0.0, state.reward - before["last_reward"])
        state = self._remember(state, before, state.reward, best, stuck).replace(reward=change)
        if not self.patience:
            return state
        over = stuck >= self.patience
        truncation = jnp.where(over, 0.0, state.info["truncation"])
        return state.replace(done=jnp.where(over, 1.0, state.done), info={**state.info, "truncation": truncation})

    def _remember(
        self, state: State, info: dict[str, Any], reward: jax.Array, best: jax.Array, stuck: jax.Array
    ) -> State:
        remembered = {"last_reward": reward, "best_reward": best, "stuck": stuck}
        return state.replace(info={**info, **state.info, **remembered})


class Decisions(_Wrapper):
    """The policy decides once in `steps` control steps; its action is held, and the rewards in between are summed.

    Activity, reward and time limit, all inside this wrapper, are still those of every control step. The episode's
    length must be a multiple of `steps`. Once an episode is over, nothing changes until the next decision.
    """

    def __init__(self, env: Env, steps: int):
        super().__init__(env)
        self.steps = steps

    def step(self, state: State, action: jax.Array) -> State:
        def control(before: State, _: None) -> tuple[State, jax.Array]:
            over = before.done > 0
            after = self.env.step(before, action)
            after = jax.tree.map(lambda old, new: jnp.where(over, old, new), before, after)
            return after, jnp.where(over, 0.0, after.reward)

        state, rewards = jax.lax.scan(control, state, length=self.steps)
        return state.replace(reward=jnp.sum(rewards))


class AutoReset(Wrapper):
    """Starts a new episode as soon as one is done.

    Brax's own wrapper replays one cached first state and does not change `info`. Here every reset draws a new state
    with a key from `info["reset_key"]`, if the task wants by how the episode ended (`Task.restart`). Physics state,
    observation and `info` are those of the new episode. The results of the last step remain: `reward`, `done`,
    `metrics` and `info["truncation"]`. At done = 1 the metrics are therefore those of the finished episode's last
    state. `info["step_metrics"]` is a copy of them.

    A state that is not finite, as when physics diverges, or whose observation or reward is beyond all bounds, ends its
    episode as if by the time limit, with reward 0 and metrics 0. Otherwise one such environment would spoil the
    parameters of all. Metric: `bad_envs`, 1 in such a step.

    One environment computes a new state at every step and mostly discards it (a batched branch computes both sides);
    `batch.Batch` does not.
    """

    def reset(self, rng: jax.Array) -> State:
        reset_key, first_key = jax.random.split(rng)
        state = self.env.reset(first_key)
        metrics = {**state.metrics, "bad_envs": jnp.zeros(())}
        return state.replace(metrics=metrics, info={**state.info, "reset_key": reset_key, "step_metrics": metrics})

    def step(self, state: State, action: jax.Array) -> State:
        return self.renew(self.advance(state, action))

    def advance(self, state: State, action: jax.Array) -> State:
        """The next state of the episode; it is the last one if `done` is 1."""
        # A task may leave `done` unchanged, and keeps no metric that it does not know.
        known = {name: value for name, value in state.metrics.items() if name != "bad_envs"}
        state = _without_bad(self.env.step(state.replace(done=jnp.zeros_like(state.done), metrics=known), action))
        return state.replace(info={**state.info, "step_metrics": state.metrics})

    def renew(self, state: State) -> State:
        """The first state of a new episode, with the results of the last one, if `done` is 1; else the same state."""
        reset_key, fresh_key = jax.random.split(state.info["reset_key"])
        fresh = self.env.restart(fresh_key, state)

        def choose(new: Any, old: Any) -> Any:
            return jax.tree.map(lambda a, b: jnp.where(state.done > 0, a, b), new, old)

        info = choose(fresh.info, {name: state.info[name] for name in fresh.info})
        kept = {"reset_key": reset_key} | {name: state.info[name] for name in ("truncation", "step_metrics")}
        return state.replace(
            pipeline_state=choose(fresh.pipeline_state, state.pipeline_state),
            obs=choose(fresh.obs, state.obs),
            info={**info, **kept},
        )


def _without_bad(state: State) -> State:
    """Ends the episode of a state that is not finite; see `AutoReset`."""
    leaves = jax.tree.leaves(state.pipeline_state)
    finite = [jnp.isfinite(leaf).all() for leaf in leaves if jnp.issubdtype(leaf.dtype, jnp.floating)]
    # Comparisons with NaN are false.
    bounded = [(jnp.abs(leaf) < MOST).all() for leaf in (state.obs, state.reward)]
    sound = jnp.stack(finite + bounded).all()

    def instead(value: jax.Array, other: float) -> jax.Array:
        return jnp.where(sound, value, other)

    metrics = {name: instead(value, 0.0) for name, value in state.metrics.items()}
    return state.replace(
        reward=instead(state.reward, 0.0),
        done=instead(state.done, 1.0),
        metrics={**metrics, "bad_envs": instead(jnp.zeros(()), 1.0)},
        info={**state.info, "truncation": instead(state.info["truncation"], 1.0)},
    )


def episodic(env: Env, config: PPOConfig) -> Env:
    """One environment with the configuration's time limit and decisions, and its own reward."""
    return deciding(limited(env, config), config)


def observed(env: Env, config: PPOConfig) -> Env:
    """One environment whose observation is what the configuration's policy takes."""
    return Nodes(env) if config.policy == "set" else env


def limited(env: Env, config: PPOConfig) -> Env:
    """One environment with the configuration's observation and time limit."""
    return Episode(observed(env, config), config.episode_length)


def deciding(env: Env, config: PPOConfig) -> Env:
    """One environment with the configuration's steps per decision."""
    return env if config.decision_steps == 1 else Decisions(env, config.decision_steps)
