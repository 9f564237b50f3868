"""Brax's policy and value networks, of a vector or of a set of objects, their initialisation, and inference.

Symbols: O observation size, A action size.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from brax.training.acme import running_statistics
from brax.training.agents.ppo import losses, networks
from brax.training.networks import ACTIVATION, FeedForwardNetwork

from graphrl_jax.rl.config import PPOConfig
from graphrl_jax.rl.sets import SetParams, with_sets

Policy = Callable[[Any, jax.Array, jax.Array], jax.Array]

# Normalised observations are clipped: a flag that was never on has almost no variance (only `ppo`'s floor), so that
# its first change would otherwise be an observation of 100.
_MAX_NORMALISED_OBSERVATION = 10.0


def make_networks(config: PPOConfig, observation_size: int, action_size: int) -> networks.PPONetworks:
    """Brax's policy (normal, then tanh) and value network, both on normalised observations; see also `sets`."""
    make = partial(
        networks.make_ppo_networks,
        action_size=action_size,
        policy_hidden_layer_sizes=config.policy_hidden,
        value_hidden_layer_sizes=config.value_hidden,
        activation=ACTIVATION[config.activation],
    )
    if config.policy == "set":
        made = with_sets(make, config, observation_size, _MAX_NORMALISED_OBSERVATION)
    else:
        normalise = partial(running_statistics.normalize, max_abs_value=_MAX_NORMALISED_OBSERVATION)
        made = make(observation_size, preprocess_observations_fn=normalise)
    flat = {name: _as_one_batch(getattr(made, name)) for name in ("policy_network", "value_network")}
    return replace(made, **flat)


def init_params(key: jax.Array, config: PPOConfig, observation_size: int, action_size: int) -> losses.PPONetworkParams:
    """Random parameters; the policy starts near mean 0 and standard deviation `config.initial_std`, before the tanh."""
    policy_key, value_key = jax.random.split(key)
    network = make_networks(config, observation_size, action_size)
    policy = _with_initial_std(network.policy_network.init(policy_key), len(config.policy_hidden), config.initial_std)
    return losses.PPONetworkParams(policy=policy, value=network.value_network.init(value_key))


def make_inference(config: PPOConfig, observation_size: int, action_size: int, deterministic: bool = True) -> Policy:
    """A function (policy_params, observation (..., O), key) -> action (..., A) in [-1, 1]."""
    make_policy = networks.make_inference_fn(make_networks(config, observation_size, action_size))

    def act(params: Any, observation: jax.Array, key: jax.Array) -> jax.Array:
        return make_policy(params, deterministic)(observation, key)[0]

    return act


def _as_one_batch(network: FeedForwardNetwork) -> FeedForwardNetwork:
    """The same network, which takes all leading axes of observations as one.

    On a CPU the gradient of a product with two leading axes takes a quarter longer.
    """

    def apply(normalizer: Any, params: Any, observation: jax.Array) -> jax.Array:
        output = network.apply(normalizer, params, observation.reshape(-1, observation.shape[-1]))
        return output.reshape(*observation.shape[:-1], *output.shape[1:])

    return replace(network, apply=apply)


def _with_initial_std(params: Any, num_hidden: int, initial_std: jax.Array | float) -> Any:
    """Sets the policy near mean 0 and the given standard deviation for every observation.

    The last layer (named by Brax) outputs means and raw deviations; Brax's distribution takes softplus(raw) + 0.001 as
    the standard deviation.
    """
    if isinstance(params, SetParams):
        return params._replace(trunk=_with_initial_std(params.trunk, num_hidden, initial_std))
    name = f"hidden_{num_hidden}"
    layer = params["params"][name]
    raw = jnp.log(jnp.expm1(initial_std - 0.001))
    half = layer["bias"].shape[0] // 2
    layer = {"kernel": 0.01 * layer["kernel"], "bias": layer["bias"].at[half:].set(raw)}
    return {**params, "params": {**params["params"], name: layer}}
