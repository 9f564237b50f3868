"""Ranges of settings, and settings that change nothing beside others."""

import math
from collections.abc import Mapping
from typing import Any

from graphrl_jax.experiment.methods import Method
from graphrl_jax.pretrain.config import PretrainHyper
from graphrl_jax.rl.config import PPOConfig
from graphrl_jax.task import Task

POSITIVE = {
    "pretrain.learning_rate", "pretrain.max_grad_norm", "pretrain.temperature", "pretrain.exponent",
    "ppo.learning_rate", "ppo.decay_updates", "ppo.clip", "ppo.max_grad_norm", "ppo.reward_scaling",
}  # fmt: skip
"""Floats that must be above 0."""
SHARES = {
    "pretrain.warmup", "pretrain.suppress_robot", "pretrain.robot_messages", "pretrain.rearranged", "pretrain.bumped",
    "pretrain.bumped_before", "pretrain.in_order", "pretrain.even", "ppo.discount", "ppo.gae_lambda",
}  # fmt: skip
"""Floats between 0 and 1, both included. All others must not be negative."""

SWITCHED_OFF: Mapping[str, tuple[float, tuple[str, ...]]] = {
    "alpha": (1.0, ("bumped_before",)),
    "even": (1.0, ("exponent",)),
    "rearranged": (0.0, ("bumped", "bumped_before", "approach", "in_order")),
    "reconstruction_weight": (0.0, ("decode_from",)),
    "tcc_weight": (0.0, ("temperature", "tcc_loss")),
    "warmup": (1.0, ("final_learning_rate",)),
}
"""By float of pretraining: the value that leaves a part out, and the fields that then change nothing."""


def refuse_switched_off(pretrain: PretrainHyper, asked: Mapping[str, Any]) -> None:
    """Refuses requested fields that change nothing beside the other values.

    Raises:
      ValueError: see above.
    """
    for part, (off, names) in SWITCHED_OFF.items():
        for name in names:
            if name in asked and getattr(pretrain, part) == off:
                raise ValueError(f"pretrain.{name} changes nothing while pretrain.{part} is {off:g}; leave it out")


def refuse_no_loss(pretrain: PretrainHyper, method: Method) -> None:
    """Refuses a loss in which no term is left.

    Raises:
      ValueError: see above.
    """
    if pretrain.tcc_weight > 0:
        return
    if method.needs == "images":
        raise ValueError("pretrain.tcc_weight is 0; allowed: above 0, since images are not reconstructed")
    if pretrain.reconstruction_weight == 0:
        raise ValueError(
            "pretrain.tcc_weight and pretrain.reconstruction_weight are both 0; allowed: one of them above 0"
        )


def refuse_outside(name: str, value: float) -> None:
    """Refuses a float outside its range.

    Raises:
      ValueError: see above.
    """
    sound, allowed = math.isfinite(value) and value >= 0, "0 or more"
    if name in POSITIVE:
        sound, allowed = sound and value > 0, "above 0"
    if name in SHARES:
        sound, allowed = sound and value <= 1, "0 to 1"
    if not sound:
        raise ValueError(f"{name} is {value}; allowed: {allowed}")


def refuse_no_retreat(ppo_config: PPOConfig, task: Task) -> None:
    """Refuses a retreat of a robot whose task does not say how.

    Raises:
      ValueError: see above.
    """
    if ppo_config.retreat and not task.retreat_action:
        raise ValueError(f"retreat is {ppo_config.retreat}; allowed: 0, since task {task.name} has no retreat_action")
