"""Configuration of PPO: sizes are static (`PPOConfig`), floats are traced (`PPOHyper`).

Plain Python, so that commands start without JAX.
"""

from dataclasses import dataclass
from typing import Literal, get_args

Activation = Literal[
    "celu", "elu", "gelu", "hard_sigmoid", "hard_silu", "hard_swish", "hard_tanh", "leaky_relu", "linear",
    "log_sigmoid", "mish", "relu", "relu6", "selu", "sigmoid", "silu", "soft_sign", "softplus", "swish", "tanh",
]  # fmt: skip
"""Brax's names of activations."""
ACTIVATIONS: tuple[str, ...] = get_args(Activation)
Inputs = Literal["flat", "set"]
"""What a policy takes: the task's observation as one vector, or also the task's objects as a set (`sets`)."""
POLICIES = ("zero", "random", "expert")
"""Names of the policies that have learned nothing (`actors.policy_named`)."""


@dataclass(frozen=True)
class PPOConfig:
    """Sizes and structure of the PPO program, static and hashable.

    Attributes:
      num_envs: B, environments stepped together.
      unroll_length: T, decisions per environment and update.
      num_epochs: passes over an update's data.
      num_minibatches: gradient steps per pass; each uses whole unrolls of B / num_minibatches environments.
      episode_length: control steps until an episode is truncated.
      decision_steps: control steps per decision of the policy; the episode length must be a multiple of it.
      policy: what the policy takes: flat is the task's observation, set also all of the task's objects, in any number
        and order.
      nodes: for a set, numbers of objects and of their features; they follow from the task.
      policy_hidden: widths of the policy's hidden layers.
      value_hidden: widths of the value network's hidden layers.
      activation: activation of the hidden layers of both networks.
      initial_std: standard deviation of the policy's normal distribution at the start, before the tanh.
      progress: pay the change of the reward from step to step (see `wrappers.Progress`).
      patience: with `progress`, a training episode ends after so many control steps without a better reward; 0 for
        never.
      retreat: of these control steps, so many at the end are a retreat by the task's `retreat_action`; what the robot
        still holds leaves with it.
      normalise_reward: divide the reward by the running standard deviation of the discounted returns.
      stagger_episodes: start the first episodes at random step counts.

    Raises:
      ValueError: a field is not positive or not a multiple of what it must be, or the activation is unknown.
    """

    num_envs: int = 1024
    unroll_length: int = 16
    num_epochs: int = 4
    num_minibatches: int = 16
    episode_length: int = 120
    decision_steps: int = 1
    policy: Inputs = "flat"
    nodes: tuple[int, ...] = ()
    policy_hidden: tuple[int, ...] = (128, 128)
    value_hidden: tuple[int, ...] = (128, 128)
    activation: Activation = "tanh"
    initial_std: float = 0.6065
    progress: bool = False
    patience: int = 0
    retreat: int = 0
    normalise_reward: bool = True
    stagger_episodes: bool = True

    def __post_init__(self) -> None:
        sizes = ("num_envs", "unroll_length", "num_epochs", "num_minibatches", "episode_length", "decision_steps")
        for name in sizes:
            if getattr(self, name) < 1:
                raise ValueError(f"{name} is {getattr(self, name)}; allowed: 1 or more")
        if self.patience < 0:
            raise ValueError(f"patience is {self.patience}; allowed: 0 or more")
        if self.patience and not self.progress:
            raise ValueError(f"patience is {self.patience} without progress; allowed: 0")
        if not 0 <= self.retreat <= max(self.patience - 1, 0):
            raise ValueError(f"retreat is {self.retreat}; allowed: 0, or up to patience ({self.patience}) less 1")
        for name, part in (("num_envs", "num_minibatches"), ("episode_length", "decision_steps")):
            value, least = getattr(self, name), getattr(self, part)
            if value % least:
                raise ValueError(f"{name} is {value}; allowed: a multiple of {part} ({least})")
        if self.policy not in get_args(Inputs):
            raise ValueError(f"policy is {self.policy!r}; allowed: {', '.join(get_args(Inputs))}")
        if (self.policy == "set") != (len(self.nodes) == 2):
            raise ValueError(f"nodes is {self.nodes} for policy {self.policy!r}; allowed: two numbers for 'set' alone")
        if not self.initial_std > 0.001:
            raise ValueError(f"initial_std is {self.initial_std}; allowed: above 0.001")
        if self.activation not in ACTIVATIONS:
            raise ValueError(f"activation is {self.activation!r}; allowed: {', '.join(ACTIVATIONS)}")

    @property
    def steps_per_update(self) -> int:
        """Control steps per update, B x T x decision_steps."""
        return self.num_envs * self.unroll_length * self.decision_steps


@dataclass(frozen=True)
class PPOHyper:
    """Hyperparameters that need no recompilation: floats, or () float32 arrays inside a program.

    Attributes:
      learning_rate: Adam's step size at the first update.
      final_learning_rate: step size after `decay_updates` updates; linear in between, constant afterwards.
      decay_updates: updates over which the learning rate falls.
      discount: gamma, per decision.
      gae_lambda: lambda of the generalised advantage estimate.
      clip: clipping range of the probability ratio around 1.
      entropy_cost: weight of the entropy bonus.
      value_cost: weight of the value loss (Brax's `vf_coefficient`, which Brax halves once more).
      max_grad_norm: global norm to which the gradient is clipped.
      reward_scaling: factor on the reward, after its normalisation.
    """

    learning_rate: float = 1e-3
    final_learning_rate: float = 3e-4
    decay_updates: float = 100.0
    discount: float = 0.99
    gae_lambda: float = 0.95
    clip: float = 0.2
    entropy_cost: float = 0.01
    value_cost: float = 0.5
    max_grad_norm: float = 0.5
    reward_scaling: float = 1.0
