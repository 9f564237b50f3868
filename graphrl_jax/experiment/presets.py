"""Presets: sizes of a run for a device. Plain Python, so that commands start without JAX."""

from collections.abc import Mapping
from dataclasses import dataclass

from graphrl_jax.encoder.config import RESNET_18, EncoderConfig, PixelConfig
from graphrl_jax.experiment.methods import Needs
from graphrl_jax.pretrain.config import PretrainConfig
from graphrl_jax.rl.config import PPOConfig


@dataclass(frozen=True)
class Preset:
    """Sizes of a run.

    Attributes:
      demonstrations: expert demonstrations if no file is given; the audit adds a quarter as many failures.
      pretrain_config: sizes of pretraining, by the method's input.
      ppo_config: sizes of PPO; the episode length and the steps per decision are the task's.
      updates: PPO updates.
      updates_per_chunk: updates per compiled call; checkpoints and log lines are written once per chunk.
      episodes: episodes of the final evaluation.
    """

    demonstrations: int
    pretrain_config: Mapping[Needs, PretrainConfig]
    ppo_config: PPOConfig
    updates: int
    updates_per_chunk: int
    episodes: int


def _images(pixels: PixelConfig, steps: int, batch_size: int = 8, num_frames: int = 40) -> PretrainConfig:
    return PretrainConfig(steps, batch_size, num_frames, EncoderConfig("pixels", pixels=pixels))


PRESETS: dict[str, Preset] = {
    "smoke": Preset(
        demonstrations=8,
        pretrain_config={
            "graphs": PretrainConfig(steps=40, batch_size=4, num_frames=20),
            "images": _images(PixelConfig(size=32, widths=(8, 8)), steps=10, batch_size=2, num_frames=10),
        },
        ppo_config=PPOConfig(num_envs=64, unroll_length=8, num_epochs=2, num_minibatches=2),
        updates=4,
        updates_per_chunk=2,
        episodes=16,
    ),
    "cpu": Preset(
        demonstrations=64,
        pretrain_config={"graphs": PretrainConfig(), "images": _images(PixelConfig(), steps=1000)},
        # Two passes teach as much per step as four with as many gradient steps, and take half of the time for them.
        ppo_config=PPOConfig(num_envs=1024, num_epochs=2, num_minibatches=32),
        updates=400,
        updates_per_chunk=10,
        episodes=256,
    ),
    "gpu": Preset(
        demonstrations=64,
        pretrain_config={"graphs": PretrainConfig(), "images": _images(RESNET_18, steps=4000)},
        ppo_config=PPOConfig(num_envs=4096, num_minibatches=16),
        updates=300,
        updates_per_chunk=10,
        episodes=256,
    ),
}


def preset_named(name: str) -> Preset:
    """The preset of that name.

    Raises:
      ValueError: there is none; the message lists the known ones.
    """
    if name not in PRESETS:
        raise ValueError(f"unknown preset {name!r}; known presets: {', '.join(PRESETS)}")
    return PRESETS[name]
