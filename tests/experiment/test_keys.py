"""Random keys of run stages."""

import jax
import numpy as np

from graphrl_jax.experiment.keys import RunStage, stage_key


def test_the_numbers_of_stages_never_change():
    assert {stage.name: int(stage) for stage in RunStage} == {
        "DEMONSTRATIONS": 0, "PRETRAIN": 1, "LANDSCAPE": 2, "POLICY": 3, "EVALUATION": 4, "RECORDING": 5, "GOAL": 6,
        "STARTS": 7,
    }  # fmt: skip


def test_every_seed_and_stage_has_a_key_of_its_own():
    data = [jax.random.key_data(stage_key(seed, stage)) for seed in (0, 1, 1000) for stage in RunStage]
    assert len(np.unique(np.array(data), axis=0)) == len(data)
