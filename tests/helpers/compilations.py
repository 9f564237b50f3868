"""How many members the programs of a sweep are compiled for."""

import pytest

from graphrl_jax.experiment import batching


def count_compilations(patch: pytest.MonkeyPatch) -> list[int]:
    """The group sizes that `batching.fit` compiles for from now on, in order; the list grows with each."""
    compiled: list[int] = []
    fit = batching.fit

    def counted(compile_for, members, budget=None):
        def compile_and_count(size):
            compiled.append(size)
            return compile_for(size)

        return fit(compile_and_count, members, budget)

    patch.setattr(batching, "fit", counted)
    return compiled
