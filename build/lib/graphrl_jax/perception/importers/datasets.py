"""What the readers of robots' datasets share: the choice of a camera, and checks of fields."""

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from graphrl_jax.perception.importers.recording import ImportFailure


def chosen_camera(dataset: Path, known: Sequence[str], asked: str | None) -> str:
    """The camera that was asked for, or the only one of a dataset.

    Raises:
      ImportFailure: the dataset has no camera, or several and none was asked for, or lacks the one asked for.
    """
    if not known:
        raise ImportFailure(f"{dataset} has no camera; allowed: one or more")
    if asked is None and len(known) > 1:
        raise ImportFailure(f"{dataset} has the cameras {', '.join(known)}; --camera says which to read")
    if asked is not None and asked not in known:
        raise ImportFailure(f"--camera is {asked!r}; {dataset} has {', '.join(known)}")
    return known[0] if asked is None else asked


def json_object(text: str, where: str) -> dict[str, Any]:
    """The object that a JSON text holds.

    Raises:
      ImportFailure: it is no JSON, or no object.
    """
    try:
        content = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ImportFailure(f"{where}: no JSON: {error}") from None
    if not isinstance(content, dict):
        raise ImportFailure(f"{where} is of type {type(content).__name__}; allowed: a JSON object")
    return content


def whole(value: Any, what: str, least: int = 0) -> int:
    """A whole number.

    Raises:
      ImportFailure: it is none, or is below `least`.
    """
    if isinstance(value, bool) or not isinstance(value, int) or value < least:
        raise ImportFailure(f"{what} is {value!r}; allowed: whole numbers from {least}")
    return value


def rate(value: Any, what: str) -> float:
    """A frame rate in frames per second.

    Raises:
      ImportFailure: it is no finite number above 0.
    """
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value <= sys.float_info.max:
        raise ImportFailure(f"{what} is {value!r}; allowed: finite numbers above 0")
    return float(value)
