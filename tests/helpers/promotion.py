"""Rank promotion is an error in the session, but not in MJX and Brax, which add vectors to matrices."""

import jax
from brax.training.acme import running_statistics
from mujoco import mjx


def allow_elsewhere() -> None:
    """Lets the functions of others that promote ranks do so."""
    for module, name in ((mjx, "step"), (running_statistics, "normalize"), (running_statistics, "update")):
        setattr(module, name, jax.numpy_rank_promotion("allow")(getattr(module, name)))
