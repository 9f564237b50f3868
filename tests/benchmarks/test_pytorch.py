"""PyTorch's steps beside ours."""

import importlib

import pytest

from benchmarks import scaling
from graphrl_jax.pretrain.config import PretrainConfig
from graphrl_jax.registry import make_task


def test_pytorchs_steps_are_ours():
    pytest.importorskip("torch", exc_type=ImportError)
    pytorch = importlib.import_module("benchmarks.pytorch")
    objects, config = make_task("match_regions").objects, PretrainConfig(batch_size=3, num_frames=6)
    batches = [scaling.made_up_batch(config, objects, seed) for seed in range(3)]
    losses = {name: [call(), call()] for name, call in pytorch.steps_of(objects, config, batches, seed=0).items()}
    assert losses["jax"][1] < losses["jax"][0]
    for found in losses.values():
        assert found == pytest.approx(losses["jax"], rel=1e-3)
