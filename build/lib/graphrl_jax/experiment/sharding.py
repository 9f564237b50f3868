"""Sharding over devices and processes: sweep members on one axis of the mesh, environments on the other.

The programs stay the same, and the compiler inserts the communication between devices. Several processes (`join`) share
one mesh of all their devices; each runs the same code and gets the same results.
"""

import math
from typing import Any

import jax
import numpy as np
from jax.experimental import multihost_utils
from jax.sharding import Mesh, NamedSharding, PartitionSpec

from graphrl_jax.rl.ppo import TrainState
from graphrl_jax.storage import is_key

MEMBERS, ENVIRONMENTS = "members", "environments"


def join(coordinator: str, processes: int, process: int) -> None:
    """Makes this process one of several; call it before any computation.

    Args:
      coordinator: address and port of the first process, such as localhost:12345.
      processes: number of processes.
      process: index of this process, from 0.

    Raises:
      ValueError: the index is out of range, or the other processes cannot be reached.
    """
    if not 0 <= process < processes:
        raise ValueError(f"--process is {process}; allowed: 0 to {processes - 1}")
    try:
        jax.distributed.initialize(coordinator, processes, process)
    except RuntimeError as error:
        raise ValueError(f"--coordinator {coordinator}: {error}") from error


def mesh_for(members: int, num_envs: int) -> Mesh:
    """Mesh (members, environments) of all devices: members take gcd(members, devices) rows, environments the columns.

    Raises:
      ValueError: the environments cannot be divided evenly among the columns.
    """
    devices = np.array(jax.devices())
    rows = math.gcd(members, devices.size)
    columns = devices.size // rows
    if num_envs % columns:
        raise ValueError(f"num_envs is {num_envs}; allowed on {devices.size} devices: multiples of {columns}")
    return Mesh(devices.reshape(rows, columns), (MEMBERS, ENVIRONMENTS))


def per_member(mesh: Mesh, count: int) -> NamedSharding:
    """Sharding of arrays with a leading member axis if `count` is above 1; else every device has the whole array."""
    return NamedSharding(mesh, PartitionSpec(MEMBERS)) if count > 1 else everywhere(mesh)


def everywhere(mesh: Mesh) -> NamedSharding:
    """Replicated sharding: every device has the whole array."""
    return NamedSharding(mesh, PartitionSpec())


def of_train_state(mesh: Mesh, count: int) -> TrainState:
    """Sharding of `count` training states: environments are distributed over the columns, parameters are not."""
    whole = per_member(mesh, count)
    shared = NamedSharding(mesh, PartitionSpec(*([MEMBERS] if count > 1 else []), ENVIRONMENTS))
    return TrainState(
        params=whole,  # type: ignore[arg-type]  # a sharding stands for all leaves of its part
        optimizer=whole,  # type: ignore[arg-type]
        normalizer=whole,  # type: ignore[arg-type]
        return_statistics=whole,  # type: ignore[arg-type]
        discounted_returns=shared,  # type: ignore[arg-type]
        env_state=shared,  # type: ignore[arg-type]
        key=whole,  # type: ignore[arg-type]
        updates=whole,  # type: ignore[arg-type]
    )


def put(tree: Any, sharding: Any) -> Any:
    """Places the leaves of a tree by `sharding` (one for all, or one per part), also on other processes.

    Every process has to hold the same values. Typed keys are transferred as their data.
    """
    data = jax.tree.map(lambda leaf: jax.random.key_data(leaf) if is_key(leaf) else leaf, tree)
    placed = jax.device_put(data, sharding)
    return jax.tree.map(lambda leaf, there: jax.random.wrap_key_data(there) if is_key(leaf) else there, tree, placed)


def agreed(value: int, what: str) -> int:
    """`value`, after a check that all processes have the same one.

    Raises:
      ValueError: the processes differ; the message names `what`.
    """
    if jax.process_count() > 1:
        values = np.ravel(multihost_utils.process_allgather(np.int32(value))).tolist()
        if len(set(values)) > 1:
            raise ValueError(f"{what} differs between processes: {values}; copy the first one's folder to the others")
    return value


def to_host(tree: Any) -> Any:
    """Copies all leaves to NumPy arrays from all devices; typed keys stay keys. Every process has to call it."""

    def fetch(leaf: Any) -> Any:
        data = jax.random.key_data(leaf) if is_key(leaf) else leaf
        whole = data if jax.process_count() == 1 else multihost_utils.process_allgather(data, tiled=True)
        return jax.random.wrap_key_data(np.asarray(whole)) if is_key(leaf) else np.asarray(whole)

    return jax.tree.map(fetch, tree)
