"""Configuration of pretraining: sizes are static, floats are traced.

Plain Python, so that commands start without JAX.
"""

from dataclasses import dataclass, field
from typing import Literal, get_args

from graphrl_jax.encoder.config import ACTIVITY_RULES, DECODER_INPUTS, ActivityRule, DecoderInput, EncoderConfig

TCCLoss = Literal["regression_mse", "regression_mse_var", "regression_huber", "classification"]
TCC_LOSSES: tuple[str, ...] = get_args(TCCLoss)


@dataclass(frozen=True)
class PretrainConfig:
    """Sizes and structure of the pretraining program, all static.

    Attributes:
      steps: number of optimiser steps.
      batch_size: demonstrations per step, drawn without replacement; all if there are fewer.
      num_frames: frames per demonstration, drawn without replacement, in order of time.
      encoder: kind and sizes of the encoder.
      decode_from: embedding that the decoder reconstructs from.
      tcc_loss: form of the TCC loss (see `tcc.cycle_loss`).
      activity: rule by which an object becomes active; all but displacement are ablations (`graph.update_activity`).

    Raises:
      ValueError: a value that is not allowed; the message names the field.
    """

    steps: int = 3000
    batch_size: int = 16
    num_frames: int = 40
    encoder: EncoderConfig = field(default_factory=EncoderConfig)
    decode_from: DecoderInput = "node"
    tcc_loss: TCCLoss = "regression_mse"
    activity: ActivityRule = "displacement"

    def __post_init__(self) -> None:
        for name, least in (("steps", 1), ("batch_size", 2), ("num_frames", 2)):
            if getattr(self, name) < least:
                raise ValueError(f"PretrainConfig.{name} is {getattr(self, name)}; allowed: {least} or more")
        names = (("decode_from", DECODER_INPUTS), ("tcc_loss", TCC_LOSSES), ("activity", ACTIVITY_RULES))
        for name, known in names:
            if getattr(self, name) not in known:
                raise ValueError(f"PretrainConfig.{name} is {getattr(self, name)!r}; allowed: {', '.join(known)}")


@dataclass(frozen=True)
class PretrainHyper:
    """Hyperparameters that need no recompilation: floats, or () float32 arrays inside a program.

    Embeddings are not normalised, so the TCC depends only on embeddings divided by the root of the temperature. XIRL's
    temperature of 1 is meant for features of a pretrained network. At 1, the embeddings of a fresh encoder are one
    point: the TCC is 1/12, at a saddle that some trainings never leave.

    Attributes:
      learning_rate: peak of the learning-rate schedule.
      final_learning_rate: learning rate at the end of the cosine schedule.
      warmup: share of the steps with linear warm-up, 0 to 1.
      weight_decay: weight decay, decoupled from the gradient.
      max_grad_norm: global norm to which the gradient is clipped.
      alpha: weight of active nodes in the pooling (Eq. 1).
      suppress_robot: 1 leaves the robot's node out of the pooling, 0 keeps it.
      tau: activity threshold, in box diagonals.
      robot_messages: weight of the robot among a node's senders, 0 to 1.
      temperature: temperature of the TCC, in squared units of the embedding.
      tcc_weight: weight of the TCC in the loss.
      reconstruction_weight: weight of box error plus class cross-entropy in the loss.
      rearranged: share of demonstrations that are rearranged; 0 as in the paper.
      bumped: probability that a rearrangement bumps an object that was never moved.
      bumped_before: probability that a rearrangement shows such an object as moved from the start.
      approach: time of the robot's way to an object in a rearrangement, relative to bringing an object as far.
      in_order: probability that a rearrangement keeps the demonstrated order of objects.
      even: 1 fits the exponent that makes the reward rise evenly (`reward.model.fit_reward`), 0 takes `exponent`.
      exponent: exponent of the scaled distance where `even` is 0; 1 as in Eq. 3.
    """

    learning_rate: float = 3e-3
    final_learning_rate: float = 0.0
    warmup: float = 0.05
    weight_decay: float = 1e-5
    max_grad_norm: float = 1.0
    alpha: float = 2.0
    suppress_robot: float = 1.0
    tau: float = 0.15
    robot_messages: float = 1.0
    temperature: float = 0.01
    tcc_weight: float = 1.0
    reconstruction_weight: float = 0.1
    rearranged: float = 1.0
    bumped: float = 0.2
    bumped_before: float = 0.5
    approach: float = 0.15
    in_order: float = 0.5
    even: float = 1.0
    exponent: float = 1.0
