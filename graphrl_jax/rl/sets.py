"""A policy and a value network that see objects as a set: any number of them, in any order.

An observation is a vector that is not about single objects, then M nodes with F features each. All nodes pass through
the same perceptron; a few learned queries attend to those that are there:

    h_i = perceptron(x_i)        s_iq = h_i . q / sqrt(H)        pooled_q = sum_i softmax_i(s_iq) h_i

Brax's networks then take the vector and what every query found. Symbols: O observation size, A action size, H hidden
size. The first feature of a node is 1 if the object is there, else 0.
"""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from brax.training.acme import running_statistics
from brax.training.agents.ppo.networks import PPONetworks
from brax.training.networks import FeedForwardNetwork

from graphrl_jax.encoder.layers import Perceptron, init_perceptron, init_weight, perceptron
from graphrl_jax.rl.config import PPOConfig

_HIDDEN, _QUERIES = 64, 4
_NEVER = -1e9
POOLED = _QUERIES * _HIDDEN
"""Size of what the queries find."""


class SetParams(NamedTuple):
    """Parameters of a network.

    | field   | shape        | meaning                             |
    |---------|--------------|-------------------------------------|
    | nodes   | F -> H -> H  | perceptron of every node            |
    | queries | (H, queries) | directions that nodes are looked at |
    | trunk   |              | parameters of Brax's network        |
    """

    nodes: Perceptron
    queries: jax.Array
    trunk: Any


def with_sets(make_trunk: Any, config: PPOConfig, observation_size: int, max_abs: float) -> PPONetworks:
    """Networks on observations (..., O) whose last M F entries are nodes.

    Args:
      make_trunk: makes Brax's networks for an observation size, without preprocessing.
      config: `nodes` is (M, F).
      observation_size: O.
      max_abs: normalised observations are clipped to this. Nodes are not normalised, because slots are treated alike.
    """
    count, features = config.nodes
    vector = observation_size - count * features
    trunk: PPONetworks = make_trunk(vector + POOLED)

    def init(network: FeedForwardNetwork, key: jax.Array) -> SetParams:
        node_key, query_key, trunk_key = jax.random.split(key, 3)
        nodes = init_perceptron(node_key, (features, _HIDDEN, _HIDDEN))
        return SetParams(nodes, init_weight(query_key, _HIDDEN, _QUERIES), network.init(trunk_key))

    def apply(network: FeedForwardNetwork, normalizer: Any, params: SetParams, observation: jax.Array) -> jax.Array:
        scaled = running_statistics.normalize(observation, normalizer, max_abs)[..., :vector]
        nodes = observation[..., vector:].reshape(*observation.shape[:-1], count, features)
        return network.apply(None, params.trunk, jnp.concatenate([scaled, pool(params, nodes)], axis=-1))

    return PPONetworks(
        policy_network=_wrapped(trunk.policy_network, init, apply),
        value_network=_wrapped(trunk.value_network, init, apply),
        parametric_action_distribution=trunk.parametric_action_distribution,
    )


def pool(params: SetParams, nodes: jax.Array) -> jax.Array:
    """What the queries find in nodes (..., M, F): (..., POOLED); 0 if no object is there."""
    hidden = jax.nn.relu(perceptron(params.nodes, nodes))
    there = nodes[..., :1] > 0
    # Not minus infinity: a softmax over no object would be NaN.
    scores = jnp.where(there, hidden @ params.queries / _HIDDEN**0.5, _NEVER)
    weights = jax.nn.softmax(scores, axis=-2) * there
    found = jnp.einsum("...mq,...mh->...qh", weights, hidden)
    return found.reshape(*found.shape[:-2], POOLED)


def _wrapped(network: FeedForwardNetwork, init: Any, apply: Any) -> FeedForwardNetwork:
    return FeedForwardNetwork(init=partial(init, network), apply=partial(apply, network))
