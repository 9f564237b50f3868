"""Success of experts: which tasks are tried."""

import pytest

from benchmarks.experts import Options
from graphrl_jax.registry import task_names


def test_every_registered_task_is_tried():
    assert Options().tasks == tuple(task_names())
    with pytest.raises(ValueError, match="--tasks 'sorting'; allowed: match_regions"):
        Options(tasks=("sorting",))
    with pytest.raises(ValueError, match="episodes is 0; allowed: 1 or more"):
        Options(episodes=0)
