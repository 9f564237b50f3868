"""Proximal policy optimisation as one pure function of (configuration, hyperparameters, reward, state).

Brax's `ppo.train` contains its own loop, so it cannot be vmapped and takes no reward as an argument. This loop is built
from Brax's parts (`acting.generate_unroll`, `ppo.losses`, `ppo.networks`, `acme.running_statistics`):

    state = init(config, make_env, reward_params, key)
    state, metrics = update(config, make_env, hyper, reward_params, state)

Both are pure and can be vmapped over keys, hyperparameters and reward parameters; `train_chunk` runs K updates in one
compiled program with the state donated. Integers that set shapes are static (`PPOConfig`), floats are traced
(`PPOHyper`). The reward's parameters enter through `make_env(reward_params)`, inside the traced function, so that a new
encoder, alpha, seed or learning rate needs no recompilation. Keep one `make_env` object per run, because it is part of
the compilation cache's key.

Symbols: T unroll length, B environments, O observation size, A action size, K updates.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from brax.envs.base import Env, State
from brax.training import acting
from brax.training.acme import running_statistics
from brax.training.acme.running_statistics import RunningStatisticsState
from brax.training.acme.specs import Array as ArraySpec
from brax.training.agents.ppo import losses, networks
from brax.training.types import Transition

from graphrl_jax.optimizer import AdamState, adam_init, adam_update, clip_by_global_norm
from graphrl_jax.rl.batch import stagger, vectorise
from graphrl_jax.rl.config import PPOConfig, PPOHyper
from graphrl_jax.rl.networks import init_params, make_networks
from graphrl_jax.runtime import jit_physics

jax.tree_util.register_dataclass(PPOHyper)
Metrics = dict[str, jax.Array]
MakeEnv = Callable[[Any], Env]

# Step metrics that are meaningful only at the end of an episode.
OUTCOMES = ("success", "score", "episode_return", "episode_length")

# Added to the variance of every observation, so that the first change of a constant one is not divided by zero.
_OBSERVATION_VARIANCE_FLOOR = 1e-4


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class TrainState:
    """Everything that the next update depends on; a run resumes exactly from the saved leaves.

    | field              | shape | dtype   | meaning                                                                   |
    |--------------------|-------|---------|---------------------------------------------------------------------------|
    | params             |       | float32 | Brax's `PPONetworkParams` (policy, value)                                 |
    | optimizer          |       |         | `AdamState`                                                               |
    | normalizer         | (O,)  | float32 | running mean and standard deviation of the observation                    |
    | return_statistics  | ()    | float32 | running standard deviation of the discounted return                       |
    | discounted_returns | (B,)  | float32 | discounted sum of past rewards in the episode                             |
    | env_state          | (B,)  |         | batched Brax `State`; its `info` holds steps, activity and reset keys     |
    | key                | ()    | key     | source of all later randomness                                            |
    | updates            | ()    | int32   | updates made                                                              |
    """

    params: losses.PPONetworkParams
    optimizer: AdamState
    normalizer: RunningStatisticsState
    return_statistics: RunningStatisticsState
    discounted_returns: jax.Array
    env_state: State
    key: jax.Array
    updates: jax.Array


def init(config: PPOConfig, make_env: MakeEnv, reward_params: Any, key: jax.Array) -> TrainState:
    """The state before the first update.

    Args:
      config: static sizes.
      make_env: builds ONE unbatched environment from the reward's parameters.
      reward_params: any pytree.
      key: typed key, the source of all randomness in the run.
    """
    reset_key, stagger_key, network_key, train_key = jax.random.split(key, 4)
    env = vectorise(make_env(reward_params), config)
    env_state = env.reset(jax.random.split(reset_key, config.num_envs))
    if config.stagger_episodes:
        env_state = stagger(env_state, stagger_key, config)
    observation_size = env_state.obs.shape[-1]
    params = init_params(network_key, config, observation_size, env.action_size)
    return _strong(
        TrainState(
            params=params,
            optimizer=adam_init(params),
            normalizer=running_statistics.init_state(
                ArraySpec((observation_size,), jnp.float32), std_eps=_OBSERVATION_VARIANCE_FLOOR
            ),
            return_statistics=running_statistics.init_state(ArraySpec((), jnp.float32)),
            discounted_returns=jnp.zeros(config.num_envs, jnp.float32),
            env_state=env_state,
            key=train_key,
            updates=jnp.zeros((), jnp.int32),
        )
    )


def unroll(
    config: PPOConfig, make_env: MakeEnv, reward_params: Any, state: TrainState, key: jax.Array
) -> tuple[State, Transition]:
    """T steps of the policy in each of B environments: the final states, and the transitions, leaves (T, B, ...)."""
    env = vectorise(make_env(reward_params), config)
    network = make_networks(config, state.env_state.obs.shape[-1], env.action_size)
    policy = networks.make_inference_fn(network)((state.normalizer, state.params.policy))
    return acting.generate_unroll(
        env, state.env_state, policy, key, config.unroll_length, extra_fields=("truncation", "step_metrics")
    )


def update(
    config: PPOConfig, make_env: MakeEnv, hyper: PPOHyper, reward_params: Any, state: TrainState
) -> tuple[TrainState, Metrics]:
    """One update: T steps in each of B environments, then num_epochs x num_minibatches gradient steps. Pure.

    The unroll and the loss use the same observation statistics, which are updated only after the gradient steps. The
    probability ratio is therefore 1 at the first gradient step. (Brax updates them in between.)

    Returns:
      The next state and scalar float32 metrics: the mean over the unroll of each step metric of the environment
      (such as `env_reward`, `learned_reward`, `distance`) and of `reward`; `episodes`, the number of finished episodes,
      and the mean of each of `OUTCOMES` over them (NaN if none finished); and diagnostics of the loss, among them
      `skipped_steps`, the share of gradient steps left out because the gradient was not finite.
    """
    unroll_key, sgd_key, next_key = jax.random.split(state.key, 3)
    env_state, data = unroll(config, make_env, reward_params, state, unroll_key)
    network = make_networks(config, data.observation.shape[-1], data.action.shape[-1])
    metrics = _unroll_metrics(data)
    # The loss uses only the last of the next observations, and never the squashed action.
    extras = {
        "policy_extras": data.extras["policy_extras"],
        "state_extras": {"truncation": data.extras["state_extras"]["truncation"]},
    }
    data = data._replace(action=(), next_observation=data.next_observation[-1:], extras=extras)

    return_statistics, discounted_returns = update_return_statistics(
        state.return_statistics, state.discounted_returns, data.reward, data.discount, hyper.discount
    )
    reward_scale = hyper.reward_scaling
    if config.normalise_reward:
        reward_scale = reward_scale / (return_statistics.std + 1e-8)
    metrics["explained_variance"] = _explained_variance(network, hyper, reward_scale, state, data)
    learning_rate = _linear_decay(hyper, state.updates)
    loss = partial(_loss, network, hyper, reward_scale)
    params, optimizer, loss_metrics = _gradient_steps(config, hyper, learning_rate, loss, state, data, sgd_key)
    state = TrainState(
        params=params,
        optimizer=optimizer,
        normalizer=running_statistics.update(state.normalizer, data.observation),
        return_statistics=return_statistics,
        discounted_returns=discounted_returns,
        env_state=env_state,
        key=next_key,
        updates=state.updates + 1,
    )
    metrics |= loss_metrics | {"learning_rate": learning_rate, "reward_scale": jnp.asarray(reward_scale)}
    return _strong(state), metrics


def updates(
    config: PPOConfig, make_env: MakeEnv, num_updates: int, hyper: PPOHyper, reward_params: Any, state: TrainState
) -> tuple[TrainState, Metrics]:
    """K updates, not compiled: the final state, and the metrics of each update, (K,)."""

    def body(state: TrainState, _: None) -> tuple[TrainState, Metrics]:
        return update(config, make_env, hyper, reward_params, state)

    return jax.lax.scan(body, state, length=num_updates)


def train_chunk(
    config: PPOConfig, make_env: MakeEnv, hyper: PPOHyper, reward_params: Any, state: TrainState, num_updates: int
) -> tuple[TrainState, Metrics]:
    """K updates in one compiled program; `state` is donated and must not be used again.

    Returns:
      The final state, and the metrics of each update, (K,) each.
    """
    return _train_chunk(config, make_env, num_updates, as_float32(hyper), reward_params, state)


def init_jit(config: PPOConfig, make_env: MakeEnv, reward_params: Any, key: jax.Array) -> TrainState:
    """`init`, compiled. Its buffers are distinct, as donating them to `train_chunk` requires."""
    return _init(config, make_env, reward_params, key)


def as_float32(tree: Any) -> Any:
    """Every leaf as a float32 array, so that a Python float and an array of the same value share one program."""
    return jax.tree.map(lambda leaf: jnp.asarray(leaf, jnp.float32), tree)


def average_metrics(metrics: Metrics) -> dict[str, np.ndarray]:
    """Means over the leading axis, on the host.

    `episodes` is summed, and outcomes are weighted by it; they are NaN if no episode finished.
    """
    episodes = np.asarray(metrics["episodes"])
    total = episodes.sum(axis=0)

    def average(name: str, values: np.ndarray) -> np.ndarray:
        if name == "episodes":
            return total
        if name in OUTCOMES:
            weighted = np.where(episodes > 0, values * episodes, 0.0).sum(axis=0)
            return np.where(total > 0, weighted / np.maximum(total, 1.0), np.nan)
        return values.mean(axis=0)

    return {name: average(name, np.asarray(values)) for name, values in metrics.items()}


def policy_params(state: TrainState) -> tuple[RunningStatisticsState, Any]:
    """Parameters of inference: the observation statistics and the policy's parameters."""
    return state.normalizer, state.params.policy


_init = jit_physics(init, static_argnums=(0, 1))
_train_chunk = jit_physics(updates, static_argnums=(0, 1, 2), donate_argnums=(5,))


def _gradient_steps(
    config: PPOConfig,
    hyper: PPOHyper,
    learning_rate: jax.Array,
    loss: Callable,
    state: TrainState,
    data: Transition,
    key: jax.Array,
) -> tuple[losses.PPONetworkParams, AdamState, Metrics]:
    """num_epochs shuffled passes over the unroll `data` (T, B, ...): parameters, optimizer state and mean metrics."""

    def minibatch_step(carry: Any, inputs: Any) -> Any:
        params, optimizer = carry
        indices, loss_key = inputs
        # A minibatch holds whole unrolls, chosen by environment. Brax's loss expects the batch axis first.
        minibatch = jax.tree.map(lambda x: jnp.swapaxes(x[:, indices], 0, 1), data)
        grads, metrics = jax.grad(loss, has_aux=True)(params, state.normalizer, minibatch, loss_key)
        grads, norm = clip_by_global_norm(grads, hyper.max_grad_norm)
        # Adam leaves such steps out.
        metrics |= {"grad_norm": norm, "skipped_steps": 1.0 - jnp.isfinite(norm)}
        return adam_update(grads, optimizer, params, learning_rate), metrics

    def epoch(carry: Any, key: jax.Array) -> Any:
        shuffle_key, loss_key = jax.random.split(key)
        indices = jax.random.permutation(shuffle_key, config.num_envs).reshape(config.num_minibatches, -1)
        return jax.lax.scan(minibatch_step, carry, (indices, jax.random.split(loss_key, config.num_minibatches)))

    keys = jax.random.split(key, config.num_epochs)
    (params, optimizer), metrics = jax.lax.scan(epoch, (state.params, state.optimizer), keys)
    return params, optimizer, jax.tree.map(jnp.mean, metrics)


def _loss(
    network: networks.PPONetworks,
    hyper: PPOHyper,
    reward_scale: jax.Array | float,
    params: losses.PPONetworkParams,
    normalizer: RunningStatisticsState,
    data: Transition,
    key: jax.Array,
) -> tuple[jax.Array, Metrics]:
    """Brax's loss on one minibatch (B, T, ...), with diagnostics."""
    # The loss and the diagnostics need the policy's output, which costs a tenth of the gradient. Neither is
    # written so that the compiler sees that it is the same (time is first inside Brax's loss), so it is handed over.
    logits = network.policy_network.apply(normalizer, params.policy, jnp.swapaxes(data.observation, 0, 1))
    known = replace(network.policy_network, apply=lambda *_: logits)
    loss, brax_metrics = losses.compute_ppo_loss(
        params,
        normalizer,
        data,
        key,
        replace(network, policy_network=known),
        entropy_cost=hyper.entropy_cost,
        discounting=hyper.discount,
        reward_scaling=reward_scale,
        gae_lambda=hyper.gae_lambda,
        clipping_epsilon=hyper.clip,
        vf_coefficient=hyper.value_cost,
    )
    taken = jax.tree.map(lambda x: jnp.swapaxes(x, 0, 1), data.extras["policy_extras"])
    distribution = network.parametric_action_distribution
    ratio = jnp.exp(distribution.log_prob(logits, taken["raw_action"]) - taken["log_prob"])
    return loss, {
        "policy_loss": brax_metrics["policy_loss"],
        "value_loss": brax_metrics["v_loss"],
        "kl": brax_metrics["kl_mean"],
        "policy_std": brax_metrics["policy_dist_mean_std"],
        "entropy": jnp.mean(jnp.sum(distribution.create_dist(logits).entropy(), -1)),
        "clip_fraction": jnp.mean(jnp.abs(ratio - 1.0) > hyper.clip, dtype=jnp.float32),
    }


def _explained_variance(
    network: networks.PPONetworks, hyper: PPOHyper, reward_scale: jax.Array | float, state: TrainState, data: Transition
) -> jax.Array:
    """Share of the returns' variance that the value network explains, before this update's gradient steps.

    Estimated on one environment in eight, for in all of them it costs as much as a sixth of the gradient steps.
    """
    some = -(-data.reward.shape[1] // 8)
    data = jax.tree.map(lambda leaf: leaf[:, :some], data)

    def value(observation: jax.Array) -> jax.Array:
        return network.value_network.apply(state.normalizer, state.params.value, observation)

    values = value(data.observation)
    truncation = data.extras["state_extras"]["truncation"]
    targets, _ = losses.compute_gae(
        truncation,
        (1 - data.discount) * (1 - truncation),
        data.reward * reward_scale,
        values,
        value(data.next_observation[-1]),
        hyper.gae_lambda,
        hyper.discount,
    )
    return 1.0 - jnp.var(targets - values) / (jnp.var(targets) + 1e-8)


def update_return_statistics(
    statistics: RunningStatisticsState,
    returns: jax.Array,
    rewards: jax.Array,
    goes_on: jax.Array,
    discount: jax.Array | float,
) -> tuple[RunningStatisticsState, jax.Array]:
    """Adds an unroll to the running statistics of returns, the discounted sums of past rewards within an episode.

    Args:
      statistics: statistics of all earlier unrolls.
      returns: (B,), returns at the end of the last unroll.
      rewards: (T, B).
      goes_on: (T, B), 0 where the episode ended.
      discount: gamma.
    """

    def accumulate(returns: jax.Array, step: Any) -> tuple[jax.Array, jax.Array]:
        reward, goes_on = step
        returns = discount * returns + reward
        return returns * goes_on, returns

    returns, seen = jax.lax.scan(accumulate, returns, (rewards, goes_on))
    return running_statistics.update(statistics, seen), returns


def _unroll_metrics(data: Transition) -> Metrics:
    """Means of the step metrics (T, B) over all steps, and of the outcomes over the steps that end an episode."""
    steps = data.extras["state_extras"]["step_metrics"]
    done = 1.0 - data.discount
    episodes = jnp.sum(done)
    outcomes = {name: jnp.sum(steps[name] * done) / episodes for name in OUTCOMES if name in steps}
    means = {name: jnp.mean(values) for name, values in steps.items() if name not in OUTCOMES}
    return means | outcomes | {"reward": jnp.mean(data.reward), "episodes": episodes}


def _linear_decay(hyper: PPOHyper, updates: jax.Array) -> jax.Array:
    progress = jnp.clip(updates / hyper.decay_updates, 0.0, 1.0)
    return hyper.learning_rate + (hyper.final_learning_rate - hyper.learning_rate) * progress


def _strong(tree: Any) -> Any:
    """Strips weak types, which would cause a recompilation at the second call of an update."""

    def strip(leaf: Any) -> jax.Array:
        leaf = jnp.asarray(leaf)
        is_key = jnp.issubdtype(leaf.dtype, jax.dtypes.prng_key)
        return leaf if is_key else jax.lax.convert_element_type(leaf, leaf.dtype)

    return jax.tree.map(strip, tree)
