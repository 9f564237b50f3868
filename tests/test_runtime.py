"""What results say of the process that they were computed in."""

import subprocess
from pathlib import Path

import jax
import jax.numpy as jnp
import pytest

from graphrl_jax import runtime
from graphrl_jax.experiment.presets import PRESETS


def test_a_log_counts_what_is_compiled_after_it_was_made():
    log = runtime.ProcessLog()
    jax.jit(lambda x: jnp.tanh(x) * 0.123)(jnp.ones(7))
    assert log.seconds > 0.0


@pytest.mark.parametrize("hits, misses, cache", [(0, 0, "cold"), (3, 0, "warm"), (0, 2, "cold"), (1, 1, "mixed")])
def test_a_cache_is_warm_if_everything_was_in_it_and_cold_if_nothing_was(hits, misses, cache):
    log = runtime.ProcessLog()
    log.cache_hits, log.cache_misses = hits, misses
    assert log.cache == cache


def test_versions_and_device_are_named():
    assert {"python", "jax", "jaxlib", "brax", "mujoco", "mujoco-mjx", "numpy"} <= runtime.versions().keys()
    assert jax.default_backend() in runtime.device() and runtime.default_preset() in PRESETS


def test_without_a_home_folder_there_is_no_persistent_cache(monkeypatch):
    def no_home() -> Path:
        raise RuntimeError("Could not determine home directory.")

    updates = []
    monkeypatch.setattr(runtime.Path, "home", no_home)
    monkeypatch.setattr(jax.config, "update", lambda *update: updates.append(update))
    for name in ("JAX_COMPILATION_CACHE_DIR", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    runtime.configure()
    assert updates == []
    monkeypatch.setenv("XDG_CACHE_HOME", "caches")
    runtime.configure()
    assert updates == [("jax_compilation_cache_dir", str(Path("caches", "graphrl_jax", "jax")))]


@pytest.fixture(autouse=True)
def commit_is_asked_anew():
    yield
    runtime.commit.cache_clear()


def test_a_commit_is_named_where_the_sources_lie_in_a_repository(monkeypatch, tmp_path):
    runtime.commit.cache_clear()
    commit = runtime.commit()
    assert commit is None or len(commit.removesuffix("-dirty")) == 40
    monkeypatch.setattr(runtime, "__file__", str(tmp_path / "runtime.py"))
    runtime.commit.cache_clear()
    assert runtime.commit() is None  # in no repository
    subprocess.run(["git", "init", "--quiet", tmp_path], check=True)
    runtime.commit.cache_clear()
    assert runtime.commit() is None  # in one that does not know it


def test_where_git_is_missing_there_is_no_commit(monkeypatch):
    monkeypatch.setenv("PATH", str(Path("/nonexistent")))
    runtime.commit.cache_clear()
    assert runtime.commit() is None
