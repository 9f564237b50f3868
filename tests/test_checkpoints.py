"""The released runs fit the code beside them: `python -m graphrl_jax evaluate checkpoints/NAME` works."""

from pathlib import Path

import pytest

from graphrl_jax.cli import load_run
from graphrl_jax.runs import Run

RELEASED = sorted((Path(__file__).parents[1] / "checkpoints").iterdir())


@pytest.mark.parametrize("folder", RELEASED, ids=lambda folder: folder.name)
def test_a_released_run_loads_and_is_small(folder):
    task, settings, _, _ = load_run(Run(folder))
    assert (task.name, f"{settings.task}_{settings.reward}") == ("match_regions", folder.name)
    assert sum(file.stat().st_size for file in folder.rglob("*")) < 2e6
