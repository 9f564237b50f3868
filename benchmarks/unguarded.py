"""Programs without their guards against non-finite states and gradients, to measure what these cost."""

from collections.abc import Callable
from functools import wraps
from typing import Any
from unittest import mock

import jax
import jax.numpy as jnp
from brax.envs.base import State

from graphrl_jax.rl import wrappers


def _as_it_is(state: State) -> State:
    return state.replace(metrics={**state.metrics, "bad_envs": jnp.zeros(())})


def _always(values: jax.Array) -> jax.Array:
    return jnp.ones(values.shape, bool)


def unguarded(function: Callable) -> Callable:
    """`function` as it would be without guards: they are left out while it is traced."""

    @wraps(function, updated=())
    def traced(*arguments: Any) -> Any:
        with mock.patch.object(wrappers, "_without_bad", _as_it_is), mock.patch.object(jnp, "isfinite", _always):
            return function(*arguments)

    return traced
