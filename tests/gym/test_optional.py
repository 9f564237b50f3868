"""Without an optional package, one sentence says what to install."""

import subprocess
import sys

import pytest

from graphrl_jax.gym.optional import require


def test_what_is_installed_is_no_error_and_what_is_missing_names_its_extra():
    require("gymnasium", "gymnasium")
    with pytest.raises(ImportError, match=r'needs the package no_such_package: pip install "graphrl_jax\[some\]"'):
        require("no_such_package", "some")


def without_gymnasium(statement: str) -> subprocess.CompletedProcess:
    code = f"import sys; sys.modules['gymnasium'] = None; {statement}"
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)


def test_the_library_does_without_gymnasium_and_its_interfaces_ask_for_it():
    assert without_gymnasium("import graphrl_jax.rl.wrappers").returncode == 0
    answer = without_gymnasium("import graphrl_jax.gym")
    last = answer.stderr.strip().splitlines()[-1]
    assert last == 'ImportError: this needs the package gymnasium: pip install "graphrl_jax[gymnasium]"'
