"""Adam, global-norm clipping and learning-rate schedules as pure functions.

Every hyperparameter may be a Python float or a traced scalar, so a sweep over them is a `vmap` and a new value needs no
recompilation. Parameters are any pytree of float32 arrays.
"""

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike

Params = Any


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class AdamState:
    """Running moments of the gradient.

    | field | shape         | dtype   | meaning                              |
    |-------|---------------|---------|--------------------------------------|
    | step  | ()            | int32   | updates done                         |
    | mu    | as the params | float32 | decayed mean of the gradient         |
    | nu    | as the params | float32 | decayed mean of the squared gradient |
    """

    step: jax.Array
    mu: Params
    nu: Params


def adam_init(params: Params) -> AdamState:
    """The state before the first update: all zeros."""
    zeros = jax.tree.map(jnp.zeros_like, params)
    return AdamState(step=jnp.zeros((), jnp.int32), mu=zeros, nu=zeros)


def adam_update(
    grads: Params,
    state: AdamState,
    params: Params,
    learning_rate: ArrayLike,
    b1: ArrayLike = 0.9,
    b2: ArrayLike = 0.999,
    eps: ArrayLike = 1e-8,
    weight_decay: ArrayLike = 0.0,
) -> tuple[Params, AdamState]:
    """One step of Adam (Kingma and Ba 2015, Algorithm 1).

    `weight_decay` is decoupled from the gradient (Loshchilov and Hutter 2019, Algorithm 2): parameters shrink by
    `learning_rate * weight_decay` per step. A gradient that is not finite changes neither parameters nor state, which
    it would spoil for good.

    Returns:
      The new parameters and the new state.
    """
    step = state.step + 1
    mu = jax.tree.map(lambda m, g: b1 * m + (1 - b1) * g, state.mu, grads)
    nu = jax.tree.map(lambda n, g: b2 * n + (1 - b2) * g**2, state.nu, grads)
    count = step.astype(jnp.float32)
    mu_correction = 1 - b1**count
    nu_correction = 1 - b2**count

    def descend(parameter: jax.Array, m: jax.Array, n: jax.Array) -> jax.Array:
        direction = (m / mu_correction) / (jnp.sqrt(n / nu_correction) + eps)
        return parameter - learning_rate * (direction + weight_decay * parameter)

    after = jax.tree.map(descend, params, mu, nu), AdamState(step, mu, nu)
    sound = jnp.isfinite(global_norm(grads))
    return jax.tree.map(lambda new, old: jnp.where(sound, new, old), after, (params, state))


def global_norm(tree: Params) -> jax.Array:
    """Euclidean norm of all leaves as one vector, a float32 scalar."""
    return jnp.sqrt(sum(jnp.sum(leaf**2) for leaf in jax.tree.leaves(tree)))


def clip_by_global_norm(grads: Params, max_norm: ArrayLike) -> tuple[Params, jax.Array]:
    """Scales the gradient down to norm `max_norm` if its norm is larger.

    Returns:
      The clipped gradient and the norm before clipping.
    """
    norm = global_norm(grads)
    scale = max_norm / jnp.maximum(norm, max_norm)
    return jax.tree.map(lambda g: g * scale, grads), norm


def warmup_cosine(
    step: ArrayLike, total: ArrayLike, peak: ArrayLike, warmup: ArrayLike = 0.0, final: ArrayLike = 0.0
) -> jax.Array:
    """Linear warm-up from 0 to `peak` over `warmup` steps, then half a cosine down to `final` at step `total`.

    Before step 0 and after step `total` the value is constant. With `warmup` 0 the value at step 0 is `peak`.
    """
    step, total, warmup = (jnp.asarray(value, jnp.float32) for value in (step, total, warmup))
    rise = jnp.where(warmup > 0, jnp.clip(step / jnp.where(warmup > 0, warmup, 1.0), 0.0, 1.0), 1.0)
    progress = jnp.clip((step - warmup) / jnp.maximum(total - warmup, 1.0), 0.0, 1.0)
    decayed = final + (peak - final) * 0.5 * (1 + jnp.cos(jnp.pi * progress))
    return jnp.where(rise < 1, peak * rise, decayed)
