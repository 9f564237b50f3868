"""Table I: what it is made of."""

import pytest

from benchmarks import table1
from graphrl_jax.experiment.methods import METHODS


def test_unknown_methods_are_refused():
    with pytest.raises(ValueError, match="--methods 'bc'; allowed: graph, env, graphirl"):
        table1.Options(methods=("bc",))
    assert set(table1.ORDER) == set(METHODS)
