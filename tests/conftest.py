"""Settings of the test session: it compiles fast rather than well, shares compiled programs, and is strict."""

import os

import jax
import pytest

import graphrl_jax  # noqa: F401  # settles how MuJoCo renders, before MuJoCo is imported
from tests.helpers.outside_package import install
from tests.helpers.promotion import allow_elsewhere

# Most of a test's time would go into optimising programs that run for milliseconds.
if jax.__version_info__ < (0, 11):
    os.environ["XLA_FLAGS"] = os.environ.get("XLA_FLAGS", "") + " --xla_cpu_use_fusion_emitters=false"
jax.config.update("jax_disable_most_optimizations", True)
jax.config.update("jax_numpy_rank_promotion", "raise")
allow_elsewhere()


@pytest.fixture(scope="session", autouse=True)
def program_cache(tmp_path_factory, worker_id):
    """A folder, empty at first, for compiled programs: all workers and the processes that they start share it."""
    base = tmp_path_factory.getbasetemp()
    folder = (base if worker_id == "master" else base.parent) / "programs"
    jax.config.update("jax_compilation_cache_dir", str(folder))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    return folder


@pytest.fixture(scope="module")
def outside_package(tmp_path_factory, program_cache):
    """The example task's package is found as if it had been installed, by this process and those that it starts."""
    with pytest.MonkeyPatch.context() as patch:
        install(patch, tmp_path_factory.mktemp("site"))
        patch.setenv("JAX_COMPILATION_CACHE_DIR", str(program_cache))
        patch.setenv("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")
        patch.setenv("JAX_DISABLE_MOST_OPTIMIZATIONS", "1")
        yield
