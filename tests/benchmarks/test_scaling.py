"""Made-up batches of any size."""

import jax.numpy as jnp

from benchmarks import scaling
from graphrl_jax.pretrain.config import PretrainConfig


def test_a_batch_of_made_up_graphs_has_the_shapes_of_a_training():
    objects, config = scaling.table_of(9), PretrainConfig(batch_size=3, num_frames=6)
    graph, mask, times = scaling.made_up_batch(config, objects, 0)
    assert graph.boxes.shape == (3, 6, 9, 4) and graph.classes.shape == (3, 6, 9, scaling.CLASSES)
    assert mask.shape == times.shape == (3, 6) and bool(mask.all()) and (jnp.diff(times, axis=1) >= 0).all()
    assert graph.classes.sum(-1).min() == 1 and graph.robot.sum(-1).max() == 1
