"""Throughput: rates of programs that are timed in turns."""

import jax.numpy as jnp
import numpy as np
import pytest

from benchmarks import throughput


def test_rates_are_work_over_the_median_time():
    x = jnp.ones(64)
    found = throughput.measure({"physics": (jnp.sin, (x,)), "twice": (lambda x: jnp.cos(jnp.sin(x)), (x,))}, 10, 3)
    seconds = {name: float(np.median(times)) for name, times in found["seconds"].items()}
    assert all(len(times) == 3 for times in found["seconds"].values())
    assert found["steps_per_second"]["twice"] == pytest.approx(10 / seconds["twice"])
    assert found["of_physics"]["twice"] == pytest.approx(seconds["physics"] / seconds["twice"])
    assert found["of_physics"]["physics"] == 1.0


def test_empty_batches_are_refused():
    with pytest.raises(ValueError, match=r"num_envs is \(4, 0\); allowed: 1 or more"):
        throughput.Options(num_envs=(4, 0))
