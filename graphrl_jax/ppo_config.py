"""What a PPO run can be told: integers that set shapes are static (`PPOConfig`), floats are traced (`PPOHyper`)."""

from dataclasses import dataclass

import jax
from brax.training.networks import ACTIVATION


@dataclass(frozen=True)
class PPOConfig:
    """What sets shapes or the program's structure. Static and hashable.

    Attributes:
        num_envs: B, environments stepped together.
        unroll_length: T, steps per environment and update.
        num_epochs: passes over an update's data.
        num_minibatches: gradient steps per pass; each takes whole unrolls of B / num_minibatches environments.
        episode_length: steps until an episode is truncated.
        policy_hidden: widths of the policy's hidden layers.
        value_hidden: widths of the value network's hidden layers.
        activation: a name from `brax.training.networks.ACTIVATION`.
        normalise_reward: divide the reward by the running deviation of the discounted returns.
        stagger_episodes: start the first episodes at random step counts.

    Raises:
        ValueError: a field is not positive, B is not a multiple of num_minibatches, or the activation is unknown.
    """

    num_envs: int = 1024
    unroll_length: int = 16
    num_epochs: int = 4
    num_minibatches: int = 16
    episode_length: int = 120
    policy_hidden: tuple[int, ...] = (128, 128)
    value_hidden: tuple[int, ...] = (128, 128)
    activation: str = "tanh"
    normalise_reward: bool = True
    stagger_episodes: bool = True

    def __post_init__(self) -> None:
        for name in ("num_envs", "unroll_length", "num_epochs", "num_minibatches", "episode_length"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} is {getattr(self, name)}; allowed: 1 or more")
        if self.num_envs % self.num_minibatches:
            allowed = f"a multiple of num_minibatches ({self.num_minibatches})"
            raise ValueError(f"num_envs is {self.num_envs}; allowed: {allowed}")
        if self.activation not in ACTIVATION:
            raise ValueError(f"activation is {self.activation!r}; allowed: {', '.join(sorted(ACTIVATION))}")

    @property
    def steps_per_update(self) -> int:
        """Environment steps that one update takes, B x T."""
        return self.num_envs * self.unroll_length


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class PPOHyper:
    """Traced scalars: another value compiles nothing, and an array of values can be vmapped over.

    Attributes:
        learning_rate: Adam's step size at the first update.
        final_learning_rate: step size after `decay_updates` updates; linear in between, constant afterwards.
        decay_updates: updates over which the learning rate falls.
        discount: gamma, per step.
        gae_lambda: lambda of the generalised advantage estimate.
        clip: largest change of the probability ratio that is still rewarded.
        entropy_cost: weight of the entropy bonus.
        value_cost: weight of the value loss (Brax's `vf_coefficient`, which it halves once more).
        max_grad_norm: the gradient's global norm is clipped to this.
        reward_scaling: factor on the reward, after its normalisation.
    """

    learning_rate: jax.Array | float = 1e-3
    final_learning_rate: jax.Array | float = 3e-4
    decay_updates: jax.Array | float = 100.0
    discount: jax.Array | float = 0.98
    gae_lambda: jax.Array | float = 0.95
    clip: jax.Array | float = 0.2
    entropy_cost: jax.Array | float = 0.01
    value_cost: jax.Array | float = 0.5
    max_grad_norm: jax.Array | float = 0.5
    reward_scaling: jax.Array | float = 1.0
