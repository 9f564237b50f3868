"""What options of benchmarks are checked for."""

from collections.abc import Collection, Iterable
from pathlib import Path
from typing import Any

import numpy as np


def refuse_below(options: Any, **least: int) -> None:
    """Refuses numbers that are too small, and empty lists of numbers.

    Args:
      options: the fields' owner.
      least: the smallest number allowed, by field.

    Raises:
      ValueError: the message names the field.
    """
    for name, allowed in least.items():
        value = getattr(options, name)
        if np.size(value) == 0 or np.min(value) < allowed:
            raise ValueError(f"{name} is {value}; allowed: {allowed} or more")


def refuse_unknown(option: str, names: Iterable[str], known: Collection[str]) -> None:
    """Refuses names that nothing is known of.

    Raises:
      ValueError: the message names the option.
    """
    for name in names:
        if name not in known:
            raise ValueError(f"{option} {name!r}; allowed: {', '.join(known)}")


def refuse_no_checkout(option: str, folder: Path | None) -> None:
    """Refuses a folder that does not hold this repository's sources.

    Raises:
      ValueError: the message names the option.
    """
    if folder is not None and not (folder / "graphrl_jax").is_dir():
        raise ValueError(f"{option} {folder} has no folder graphrl_jax; allowed: a checkout of this repository")
