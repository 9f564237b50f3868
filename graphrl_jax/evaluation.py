"""Outcomes of whole episodes under a fixed policy, in one compiled program."""

from typing import Any

import jax
import jax.numpy as jnp
from brax.envs.base import State
from brax.envs.wrappers.training import VmapWrapper

from graphrl_jax.compilation import jit_physics
from graphrl_jax.policy import make_inference
from graphrl_jax.ppo import OUTCOMES, MakeEnv
from graphrl_jax.ppo_config import PPOConfig
from graphrl_jax.wrappers import Episode


def episode_outcomes(
    config: PPOConfig,
    make_env: MakeEnv,
    reward_params: Any,
    policy_params: Any,
    key: jax.Array,
    num_episodes: int,
    deterministic: bool = True,
) -> dict[str, jax.Array]:
    """One episode from a fresh reset in each of `num_episodes` environments, run side by side. Pure.

    Args:
      config: of the training run; gives the networks' sizes and the episode's length.
      make_env, reward_params: as for `ppo.init`. The return is that of the reward these define.
      policy_params: see `ppo.policy_params`.
      key: typed key; the same key gives the same episodes.
      num_episodes: static.
      deterministic: the distribution's mode instead of a sample; static.

    Returns:
      (num_episodes,) float32 for each of `ppo.OUTCOMES` that the environment reports: `success` and `score` of the
      episode's last state, `episode_return`, `episode_length`.
    """
    env = VmapWrapper(Episode(make_env(reward_params), config.episode_length))
    reset_key, act_key = jax.random.split(key)
    state = env.reset(jax.random.split(reset_key, num_episodes))
    act = make_inference(config, state.obs.shape[-1], env.action_size, deterministic)
    outcomes = {name: state.metrics[name] for name in OUTCOMES if name in state.metrics}

    def step(carry: tuple, key: jax.Array) -> tuple:
        state, running, outcomes = carry
        state = env.step(_not_done(state), act(policy_params, state.obs, key))
        # What an environment does after its episode has ended is ignored.
        outcomes = {name: jnp.where(running, state.metrics[name], old) for name, old in outcomes.items()}
        return (state, running & (state.done == 0), outcomes), None

    carry = (_not_done(state), jnp.ones(num_episodes, bool), outcomes)
    (_, _, outcomes), _ = jax.lax.scan(step, carry, jax.random.split(act_key, config.episode_length))
    return outcomes


evaluate = jit_physics(episode_outcomes, static_argnames=("config", "make_env", "num_episodes", "deterministic"))
"""`episode_outcomes`, compiled. Inside another compiled program take that one: it sets no compiler options."""


def _not_done(state: State) -> State:
    return state.replace(done=jnp.zeros_like(state.done))
