"""Every pair of settings of pretraining: one changes what the other leaves of the result, or the pair is refused."""

from collections.abc import Callable
from dataclasses import replace

import jax
import numpy as np
import pytest

from graphrl_jax.encoder import encoder
from graphrl_jax.experiment.methods import METHODS
from graphrl_jax.experiment.ranges import SWITCHED_OFF
from graphrl_jax.experiment.settings import compose
from graphrl_jax.pretrain import trainer
from graphrl_jax.registry import make_task
from graphrl_jax.rl.ppo import as_float32

TASK = make_task("match_regions")
SIZES = {"steps": 6, "batch_size": 4, "num_frames": 8}
AT = {"max_grad_norm": 1e-3, "in_order": 1.0, "bumped": 1.0, "approach": 1.0, "temperature": 0.1, "tau": 0.3,
      "robot_messages": 0.25, "suppress_robot": 0.25, "warmup": 0.5, "rearranged": 0.5}  # fmt: skip
"""Values that surely differ from the defaults in what they do."""
OFF = {"alpha": 1.0, "rearranged": 0.0, "reconstruction_weight": 0.0, "tcc_weight": 0.0, "warmup": 1.0, "bumped": 0.0,
       "bumped_before": 0.0, "robot_messages": 0.0, "suppress_robot": 1.0, "weight_decay": 0.0}  # fmt: skip
"""Values that leave something out."""
ELSEWHERE = {"even", "exponent", "tau"}
"""`even` and `exponent` are used after pretraining, and `tau` also decides what the policy observes."""


@pytest.fixture(scope="module", params=["graph", "graphirl"])
def trained(request) -> tuple[str, Callable[..., np.ndarray]]:
    """A reward, and what its encoder makes of the demonstrations after a few steps with some floats."""
    demos = TASK.demonstrate(jax.random.key(0), 6)
    settings = compose(TASK, request.param, "smoke", pretrain=SIZES)
    config, data = settings.pretrain_config, trainer.prepare(demos)
    state = trainer.init(config, data.objects, jax.random.key(1))

    def train(hyper, state):
        after, _ = trainer.run(config, hyper, data, state, SIZES["steps"])
        shown = trainer.shown_frames(config, hyper, data, jax.random.key(2), 2)
        embed = jax.vmap(jax.vmap(encoder.encode, in_axes=(None, 0, None)), in_axes=(None, 0, None))
        return embed(after.params["encoder"], shown, trainer.pooling_params(config, hyper))

    compiled = jax.jit(train)
    return request.param, lambda **floats: np.asarray(compiled(as_float32(replace(settings.pretrain, **floats)), state))


def refused(reward: str, **floats: float) -> bool:
    """Whether somebody who asks for these floats is told that one of them changes nothing."""
    try:
        compose(TASK, reward, "smoke", pretrain=floats)
    except ValueError as error:
        assert "changes nothing" in str(error) or "are both 0" in str(error)
        return True
    return False


@pytest.mark.slow
def test_whatever_is_accepted_changes_something(trained):
    reward, train = trained
    names = [name for name in METHODS[reward].floats if name not in ELSEWHERE]
    useless = []
    for part, off in OFF.items():
        others = {part: off} if part in names else {}
        before = train(**others)
        for name in names:
            asked = {**others, name: AT.get(name, 0.77)}
            if name != part and not refused(reward, **asked) and (train(**asked) == before).all():
                useless.append(asked)
    assert not useless


def test_a_loss_with_nothing_in_it_is_refused():
    message = "pretrain.tcc_weight and pretrain.reconstruction_weight are both 0; allowed: one of them above 0"
    for reward, floats in (
        ("graphirl", {"tcc_weight": 0.0}),
        ("graph", {"tcc_weight": 0.0, "reconstruction_weight": 0.0}),
    ):
        with pytest.raises(ValueError, match=message):
            compose(TASK, reward, pretrain=floats)
    with pytest.raises(
        ValueError, match="pretrain.tcc_weight is 0; allowed: above 0, since images are not reconstructed"
    ):
        compose(TASK, "xirl", pretrain={"tcc_weight": 0.0})


@pytest.mark.parametrize("part", SWITCHED_OFF)
def test_what_is_switched_off_is_refused_and_said_by_name(part):
    off, names = SWITCHED_OFF[part]
    for name in names:
        value = {"decode_from": "pooled", "tcc_loss": "classification"}.get(name, 0.5)
        message = f"pretrain.{name} changes nothing while pretrain.{part} is {off:g}; leave it out"
        with pytest.raises(ValueError, match=message):
            compose(TASK, pretrain={part: off, name: value})
        compose(TASK, pretrain={part: 0.5, name: value})
