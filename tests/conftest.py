"""Settings of the test session: compile fast rather than well; how MuJoCo renders is settled before its import."""

import os
from pathlib import Path

import jax
import pytest

# Most of a test's time would go into optimising programs that run for milliseconds.
if jax.__version_info__ < (0, 11):
    os.environ["XLA_FLAGS"] = os.environ.get("XLA_FLAGS", "") + " --xla_cpu_use_fusion_emitters=false"
jax.config.update("jax_disable_most_optimizations", True)

import graphrl_jax  # noqa: E402, F401

REPOSITORY = Path(__file__).parents[1]
OUTSIDE_PACKAGE = Path(__file__).parent / "outside_package"


@pytest.fixture(scope="module")
def outside_package(tmp_path_factory):
    """The package is found as if it had been installed; programs compiled once are shared with other processes."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(OUTSIDE_PACKAGE)
        patch.setenv("PYTHONPATH", os.pathsep.join([str(REPOSITORY), str(OUTSIDE_PACKAGE)]))
        patch.setenv("JAX_COMPILATION_CACHE_DIR", str(tmp_path_factory.mktemp("cache")))
        patch.setenv("JAX_DISABLE_MOST_OPTIMIZATIONS", "1")
        yield
