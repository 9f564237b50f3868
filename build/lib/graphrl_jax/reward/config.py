"""Names shared by commands and the reward. Plain Python, so that commands start without JAX."""

from typing import Literal, get_args

SubtaskMethod = Literal["rests", "change_points", "uvd"]
SUBTASK_METHODS: tuple[str, ...] = get_args(SubtaskMethod)
