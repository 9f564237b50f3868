"""What a whole run can be told, and the presets that fit a device."""

from dataclasses import dataclass, field, replace
from typing import Literal, get_args

import jax

from graphrl_jax.encoder import EncoderConfig
from graphrl_jax.pixels import RESNET_18, PixelConfig
from graphrl_jax.ppo_config import PPOConfig, PPOHyper
from graphrl_jax.pretrain import PretrainConfig, PretrainHyper
from graphrl_jax.tcc import VARIANTS, Variant

RewardName = Literal["graph", "graph_with_robot", "graphirl", "graphirl_with_robot", "xirl", "env"]
Ablation = Literal["reconstruction", "activity", "persistence", "edges"]
PresetName = Literal["smoke", "cpu", "gpu"]
REWARDS: tuple[RewardName, ...] = get_args(RewardName)
ABLATIONS: tuple[Ablation, ...] = get_args(Ablation)


@dataclass(frozen=True)
class Preset:
    """Sizes of a run.

    Attributes:
      demonstrations: expert demonstrations made when no file is given; a quarter as many failures join the audit.
      pretrain: static sizes of pretraining.
      xirl: the same for the encoder of pictures.
      ppo: static sizes of PPO; the episode's length is the task's.
      updates: PPO updates.
      updates_per_chunk: updates per compiled call; checkpoints and log lines come once per chunk.
      episodes: episodes of the final evaluation.
    """

    demonstrations: int
    pretrain: PretrainConfig
    xirl: PretrainConfig
    ppo: PPOConfig
    updates: int
    updates_per_chunk: int
    episodes: int


def _xirl(pixels: PixelConfig) -> EncoderConfig:
    return EncoderConfig(kind="pixels", pixels=pixels)


PRESETS: dict[str, Preset] = {
    "smoke": Preset(
        demonstrations=8,
        pretrain=PretrainConfig(steps=40, batch_size=4, num_frames=20, encoder=EncoderConfig()),
        xirl=PretrainConfig(steps=10, batch_size=2, num_frames=10, encoder=_xirl(PixelConfig(size=32, widths=(8, 8)))),
        ppo=PPOConfig(num_envs=64, unroll_length=8, num_epochs=2, num_minibatches=2),
        updates=4,
        updates_per_chunk=2,
        episodes=16,
    ),
    "cpu": Preset(
        demonstrations=64,
        pretrain=PretrainConfig(),
        xirl=PretrainConfig(steps=1000, batch_size=8, encoder=_xirl(PixelConfig())),
        ppo=PPOConfig(num_envs=1024),
        updates=250,
        updates_per_chunk=10,
        episodes=256,
    ),
    "gpu": Preset(
        demonstrations=64,
        pretrain=PretrainConfig(),
        xirl=PretrainConfig(steps=4000, batch_size=8, encoder=_xirl(RESNET_18)),
        ppo=PPOConfig(num_envs=4096, num_minibatches=16),
        updates=300,
        updates_per_chunk=10,
        episodes=256,
    ),
}


@dataclass(frozen=True)
class Settings:
    """Everything that decides a run's numbers.

    Attributes:
      task: registered name.
      reward: `graph` (robot left out of the pooling), `graph_with_robot`, GraphIRL's (`graphirl`, robot left out, or
        `graphirl_with_robot`), XIRL's of pictures (`xirl`), or the task's own, `env`.
      preset: name of the sizes used.
      seed: everything random follows from it.
      demos: path of a demonstration file, or None to let the expert make them.
      updates: policy updates, or None for the preset's.
      encoder_steps: steps of pretraining, or None for the preset's.
      pretrain: floats of pretraining, alpha among them.
      ppo: floats of PPO; the learning rate decays over all updates.
      ablations: what of the method is left out.
      tcc_variant: see `tcc.cycle_loss`.
    """

    task: str = "match_regions"
    reward: RewardName = "graph"
    preset: str = "cpu"
    seed: int = 0
    demos: str | None = None
    updates: int | None = None
    encoder_steps: int | None = None
    pretrain: PretrainHyper = field(default_factory=PretrainHyper)
    ppo: PPOHyper = field(default_factory=PPOHyper)
    ablations: tuple[Ablation, ...] = ()
    tcc_variant: Variant = "regression_mse"

    def __post_init__(self) -> None:
        if self.reward not in REWARDS:
            raise ValueError(f"unknown reward {self.reward!r}; known rewards: {', '.join(REWARDS)}")
        if self.preset not in PRESETS:
            raise ValueError(f"unknown preset {self.preset!r}; known presets: {', '.join(PRESETS)}")
        for ablation in self.ablations:
            if ablation not in ABLATIONS:
                raise ValueError(f"unknown ablation {ablation!r}; known ablations: {', '.join(ABLATIONS)}")
            foreign = self.reward.startswith("graphirl") and ablation != "persistence"
            if self.reward in ("env", "xirl") or foreign:
                raise ValueError(f"ablation {ablation!r} changes nothing about reward {self.reward!r}")
        if self.tcc_variant not in VARIANTS:
            raise ValueError(f"unknown variant of the TCC {self.tcc_variant!r}; known: {', '.join(VARIANTS)}")
        for name in ("updates", "encoder_steps"):
            value = getattr(self, name)
            if value is not None and value < 1:
                raise ValueError(f"{name} is {value}; allowed: 1 or more")

    @property
    def sizes(self) -> Preset:
        """The preset's sizes, with `updates` if given."""
        preset = PRESETS[self.preset]
        return replace(preset, updates=preset.updates if self.updates is None else self.updates)

    @property
    def pretraining(self) -> PretrainConfig:
        """Static sizes of pretraining: the preset's, with the reward's encoder and without what is ablated."""
        config = self.sizes.xirl if self.reward == "xirl" else self.sizes.pretrain
        steps = config.steps if self.encoder_steps is None else self.encoder_steps
        config = replace(config, steps=steps, tcc_variant=self.tcc_variant)
        if self.reward == "xirl":
            return config
        kind = "interaction" if self.reward.startswith("graphirl") else "message_passing"
        encoder = replace(config.encoder, kind=kind, edges="edges" not in self.ablations)
        persistent = "persistence" not in self.ablations
        return replace(config, encoder=encoder, persistent=persistent)


def default_preset() -> PresetName:
    """The preset for the device at hand."""
    return "cpu" if jax.default_backend() == "cpu" else "gpu"
