"""What the tests of several commands start from."""

import pytest

from graphrl_jax import cli
from tests.helpers.commands import call, finished_run


@pytest.fixture(scope="module")
def finished(outside_package, tmp_path_factory):
    """A run that was never interrupted; tests leave it as it is."""
    return finished_run(tmp_path_factory.getbasetemp())


@pytest.fixture(scope="module")
def demos_file(outside_package, tmp_path_factory):
    """Six successful demonstrations of the example task, and two failures."""
    file = tmp_path_factory.mktemp("demos") / "demos.npz"
    call(cli.main, "demos", "--task", "carry", "--num", 6, "--failures", 2, "--out", file)
    return file
