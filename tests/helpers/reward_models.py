"""A small reward model with a card, fitted to made-up demonstrations; its encoder has learned nothing."""

from dataclasses import replace

import jax

from graphrl_jax.encoder import encoder
from graphrl_jax.encoder.config import EncoderConfig
from graphrl_jax.encoder.pooling import PoolingParams
from graphrl_jax.reward.card import Card
from graphrl_jax.reward.model import RewardModel, fit_reward
from tests.helpers.demonstrations import demonstrations
from tests.helpers.graphs import OBJECTS

DEMOS = demonstrations(num=4, num_frames=10)
_CONFIG = EncoderConfig(num_layers=1, hidden=4, embedding=3)
CARD = Card(OBJECTS, 8.0, _CONFIG, "displacement", "sorting", "made up", 4, -0.1)


def small_model() -> RewardModel:
    params = jax.jit(encoder.init, static_argnums=(1, 2))(jax.random.key(0), _CONFIG, OBJECTS)
    return replace(fit_reward(params, DEMOS, PoolingParams(alpha=2.0, tau=0.02)), card=CARD)
