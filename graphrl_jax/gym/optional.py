"""Packages that are installed on request only."""

import importlib.util


def require(package: str, extra: str) -> None:
    """Checks that an optional package is installed.

    Raises:
      ImportError: it is not; the message names the package extra of `graphrl_jax` that installs it.
    """
    if importlib.util.find_spec(package) is None:
        raise ImportError(f'this needs the package {package}: pip install "graphrl_jax[{extra}]"')
