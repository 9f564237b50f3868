"""How long programs and calls take."""

import time
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

import jax
from jax.stages import Compiled, Wrapped

_Name = TypeVar("_Name")


def compiled(function: Wrapped, arguments: tuple) -> tuple[Compiled, float]:
    """The program of a jitted function for such arguments, and the seconds that tracing and compiling it took."""
    started = time.perf_counter()
    program = function.lower(*arguments).compile()
    return program, time.perf_counter() - started


def to_the_end(program: Callable, arguments: tuple) -> Callable[[], Any]:
    """A call of a program that waits until its results are there."""
    return lambda: jax.block_until_ready(program(*arguments))


def in_turns(calls: Mapping[_Name, Callable[[], Any]], repeats: int) -> dict[_Name, list[float]]:
    """Seconds of every call, `repeats` times; a first call of each warms up.

    They take turns, so that whatever else the machine does weighs on all of them.
    """
    seconds: dict[_Name, list[float]] = {name: [] for name in calls}
    for repeat in range(repeats + 1):
        for name, call in calls.items():
            taken = seconds_of(call)
            if repeat:
                seconds[name].append(taken)
    return seconds


def seconds_of(call: Callable[[], Any]) -> float:
    """Seconds that one call takes."""
    started = time.perf_counter()
    call()
    return time.perf_counter() - started
