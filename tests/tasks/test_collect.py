"""Collecting scripted episodes until there are enough of every kind."""

import jax
import numpy as np
import pytest

from tasks.collect import collect

KEY = jax.random.key(0)


def test_episodes_that_end_otherwise_than_planned_are_dropped_and_made_up_for():
    batches = []

    def rollouts(key, kinds):
        batches.append(kinds.tolist())
        numbers = 10 * len(batches) + np.arange(len(kinds))
        # In the first batch successes fail, and failures of kind 1 succeed.
        as_planned = (kinds == 2) | (len(batches) > 1)
        return {"number": numbers}, (kinds == 0) == as_planned

    episodes, kinds = collect(rollouts, KEY, successes=2, failures=3, failure_kinds=2, batch=6, max_batches=4)
    assert kinds.tolist() == [0, 0, 1, 1, 2]
    assert batches == [[0, 0, 1, 2, 1, 0], [0, 0, 1, 1, 0, 0]]
    assert episodes["number"].tolist() == [20, 21, 22, 23, 13]


def test_an_expert_that_fails_too_often_is_an_error():
    with pytest.raises(ValueError, match="the expert reached 0 of 3 demonstrations in 2 batches"):
        collect(lambda key, kinds: (kinds, kinds != 0), KEY, 3, 0, failure_kinds=1, batch=4, max_batches=2)
