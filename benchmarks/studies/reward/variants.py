"""What the study varies, in encoders and then in policies: one factor at a time, all else as the default has it."""

from dataclasses import dataclass, field, replace
from typing import Any

from graphrl_jax.pretrain.config import PretrainConfig, PretrainHyper


@dataclass(frozen=True)
class Variant:
    """A change to the default.

    Attributes:
      factor: what is changed; a figure's group.
      config: fields of `PretrainConfig`.
      encoder: fields of `EncoderConfig`.
      hyper: fields of `PretrainHyper`.
      demonstrations: how many, before a quarter is held out.
    """

    factor: str
    config: dict[str, Any] = field(default_factory=dict)
    encoder: dict[str, Any] = field(default_factory=dict)
    hyper: dict[str, float] = field(default_factory=dict)
    demonstrations: int = 64

    def settings(self) -> tuple[PretrainConfig, PretrainHyper]:
        """The default, trained for `STEPS`, with this change."""
        config = PretrainConfig(**{"steps": STEPS, **self.config})
        return replace(config, encoder=replace(config.encoder, **self.encoder)), PretrainHyper(**self.hyper)


# A third of the default's, which is among the variants: with it the study would take a day.
STEPS = 1000
PAPER = {"rearranged": 0.0, "reconstruction_weight": 1.0, "temperature": 1.0, "even": 0.0}

VARIANTS = {
    "default": Variant("default"),
    "paper": Variant("demonstrations seen", hyper=PAPER),
    "half_rearranged": Variant("demonstrations seen", hyper={"rearranged": 0.5}),
    "never_bumped": Variant("demonstrations seen", hyper={"bumped": 0.0}),
    "never_bumped_before": Variant("demonstrations seen", hyper={"bumped_before": 0.0}),
    "16_demonstrations": Variant("demonstrations seen", demonstrations=16),
    "approach_free": Variant("time of approaches", hyper={"approach": 0.0}),
    "approach_0.05": Variant("time of approaches", hyper={"approach": 0.05}),
    "approach_0.5": Variant("time of approaches", hyper={"approach": 0.5}),
    "approach_as_long": Variant("time of approaches", hyper={"approach": 1.0}),
    "no_reconstruction": Variant("reconstruction", hyper={"reconstruction_weight": 0.0}),
    "reconstruction_1": Variant("reconstruction", hyper={"reconstruction_weight": 1.0}),
    "reconstruction_10": Variant("reconstruction", hyper={"reconstruction_weight": 10.0}),
    "pooled_reconstruction": Variant("reconstruction", config={"decode_from": "pooled"}),
    "linear_head": Variant("network", encoder={"head_layers": 0}),
    "two_hidden_layers_in_head": Variant("network", encoder={"head_layers": 2}),
    "no_messages": Variant("network", encoder={"num_layers": 0}),
    "hidden_64": Variant("network", encoder={"hidden": 64}),
    "embedding_8": Variant("network", encoder={"embedding": 8}),
    "alpha_1": Variant("activity", hyper={"alpha": 1.0}),
    "alpha_8": Variant("activity", hyper={"alpha": 8.0}),
    "tau_0.1": Variant("activity", hyper={"tau": 0.1}),
    "with_robot": Variant("activity", hyper={"suppress_robot": 0.0}),
    "classification": Variant("TCC", config={"tcc_loss": "classification"}),
    "huber": Variant("TCC", config={"tcc_loss": "regression_huber"}),
    "variance": Variant("TCC", config={"tcc_loss": "regression_mse_var"}),
    "temperature_0.1": Variant("TCC", hyper={"temperature": 0.1}),
    "temperature_1": Variant("TCC", hyper={"temperature": 1.0}),
    "plain_distance": Variant("reward", hyper={"even": 0.0}),
    "300_steps": Variant("training", config={"steps": 300}),
    "3000_steps": Variant("training", config={"steps": 3000}),
}


@dataclass(frozen=True)
class PolicyVariant:
    """A change to how policies are trained, the encoder being the same.

    Attributes:
      task: arguments of `MatchRegions`.
      hyper: fields of `PPOHyper`.
    """

    task: dict[str, Any] = field(default_factory=dict)
    hyper: dict[str, float] = field(default_factory=dict)


POLICY_VARIANTS = {
    "default": PolicyVariant(),
    "targets_in_slots": PolicyVariant(task={"targets_in_order": False}),
    "demo_starts": PolicyVariant(task={"varied": 0.0}),
    "discount_0.99": PolicyVariant(hyper={"discount": 0.99}),
    "entropy_0.003": PolicyVariant(hyper={"entropy_cost": 0.003}),
}
