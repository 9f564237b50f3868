"""Several trainings side by side in one compiled program: members differ in floats, seeds and data, not in sizes.

Training is a pure function of traced arguments, so a sweep is a `jax.vmap` over them. A single member runs without a
member axis, so a sweep of one member gives exactly the numbers of a single run. Members that do not fit into memory
together run in groups of the same size, through the same compiled program.
"""

import re
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
from jax.stages import Wrapped

from graphrl_jax.experiment import sharding
from graphrl_jax.pretrain import trainer
from graphrl_jax.pretrain.config import PretrainConfig, PretrainHyper
from graphrl_jax.pretrain.trainer import PretrainData, PretrainState
from graphrl_jax.rl import ppo
from graphrl_jax.rl.config import PPOConfig, PPOHyper
from graphrl_jax.runtime import jit_physics

# Share of the free memory that one program may take.
_SHARE = 0.6
_UNKNOWN_BYTES = 1 << 40


def stack(members: Sequence[Any]) -> Any:
    """Stacks pytrees of the same structure along a leading member axis; a single pytree stays as it is."""
    return members[0] if len(members) == 1 else jax.tree.map(lambda *leaves: jnp.stack(leaves), *members)


def unstack(tree: Any, count: int) -> list[Any]:
    """The inverse of `stack`."""
    return [tree] if count == 1 else [jax.tree.map(lambda leaf, i=i: leaf[i], tree) for i in range(count)]


def each(function: Callable, count: int) -> Callable:
    """`function` for `count` members side by side, with arguments and results as returned by `stack`."""
    return function if count == 1 else jax.vmap(function)


def in_turn(function: Callable, count: int) -> Callable:
    """As `each`, but one member after another in the same program."""
    return function if count == 1 else lambda *stacked: jax.lax.map(lambda member: function(*member), stacked)


def pretrain_program(config: PretrainConfig, num_steps: int, count: int) -> Wrapped:
    """Program of `num_steps` steps of `count` encoders: (hyper, data, state) -> (state, metrics); see `trainer.run`.

    Members and their data are distributed over the devices. All arguments are as returned by `stack`.
    """
    where = sharding.per_member(sharding.mesh_for(count, len(jax.devices())), count)
    # On CPU the step of one member fits the caches and that of several does not: eight in turn take two thirds of the
    # time.
    alone = jax.default_backend() == "cpu" and len(jax.devices()) == 1
    mapped = in_turn if alone else each

    def run(hyper: PretrainHyper, data: PretrainData, state: PretrainState) -> tuple[PretrainState, trainer.Metrics]:
        return mapped(lambda *member: trainer.run(config, *member, num_steps), count)(hyper, data, state)

    return jax.jit(run, in_shardings=where, out_shardings=where)


def policy_programs(config: PPOConfig, make_env: ppo.MakeEnv, count: int) -> tuple[Wrapped, Callable[[int], Wrapped]]:
    """Two programs for `count` policies, with members and environments distributed over the devices.

    Returns:
      (reward_params, key) -> state, see `ppo.init`; and, for a number of updates, (hyper, reward_params, state) ->
      (state, metrics), see `ppo.updates`: the state is donated, and every device has all metrics.
    """
    mesh = sharding.mesh_for(count, config.num_envs)
    member, state_lies = sharding.per_member(mesh, count), sharding.of_train_state(mesh, count)

    def init(reward_params: Any, key: jax.Array) -> ppo.TrainState:
        return each(partial(ppo.init, config, make_env), count)(reward_params, key)

    def updates(num_updates: int) -> Wrapped:
        def run(hyper: PPOHyper, reward_params: Any, state: ppo.TrainState) -> tuple[ppo.TrainState, ppo.Metrics]:
            return each(partial(ppo.updates, config, make_env, num_updates), count)(hyper, reward_params, state)

        return jit_physics(
            run,
            in_shardings=(member, member, state_lies),
            out_shardings=(state_lies, sharding.everywhere(mesh)),
            donate_argnums=2,
        )

    return jit_physics(init, in_shardings=member, out_shardings=state_lies), updates


def free_bytes() -> int:
    """Free memory of the device in bytes; 2^40 if the system does not report it."""
    statistics = jax.devices()[0].memory_stats() if jax.default_backend() != "cpu" else None
    if statistics:
        return statistics["bytes_limit"] - statistics["bytes_in_use"]
    try:
        available = re.search(r"^MemAvailable:\s+(\d+) kB$", Path("/proc/meminfo").read_text(), re.MULTILINE)
    except OSError:
        available = None
    return 1024 * int(available[1]) if available else _UNKNOWN_BYTES


def fit(compile_for: Callable[[int], Any], members: int, budget: int | None = None) -> tuple[int, Any]:
    """The largest group of members whose program fits into memory.

    Args:
      compile_for: compiles the program for a number of members (`jax.stages.Compiled`).
      members: number of members.
      budget: bytes that the program may take; default: a share of the free memory.

    Returns:
      Members per group, and the program.
    """
    if members == 1:
        return 1, compile_for(1)
    budget = int(_SHARE * free_bytes()) if budget is None else budget
    size = members
    while True:
        program = compile_for(size)
        memory = program.memory_analysis()
        need = memory.temp_size_in_bytes + memory.argument_size_in_bytes + memory.output_size_in_bytes
        if need <= budget or size == 1:
            return size, program
        size = max(1, min(size - 1, size * budget // need))


def spread(count: int) -> int:
    """`count` members, rounded up to a multiple of the devices: otherwise every device would train all of them."""
    devices = len(jax.devices())
    return count if count == 1 else -(-count // devices) * devices


def groups(members: Sequence[Any], size: int) -> list[list[Any]]:
    """Groups of exactly `size` members; the last group repeats its last member, so that one program runs all groups."""
    cut = [list(members[start : start + size]) for start in range(0, len(members), size)]
    cut[-1] += cut[-1][-1:] * (size - len(cut[-1]))
    return cut


def each_once(group: Sequence[int], members: Sequence[Any]) -> list[tuple[int, Any]]:
    """Pairs of job and member, each job once; a group may repeat its last job."""
    return list(dict(zip(reversed(group), reversed(members), strict=True)).items())
