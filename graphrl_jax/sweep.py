"""Several trainings side by side in one compiled program: members differ in floats, seeds and data, not in sizes.

Encoders and policies are pure functions of traced arguments, so a sweep is a `jax.vmap` over those. One member is run
without an axis of its own: a sweep of one is a single run, number for number. Where all members do not fit into memory,
they go in groups of one size, through the same compiled program.
"""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
from jax.stages import Wrapped

from graphrl_jax import devices, ppo, pretrain
from graphrl_jax.compilation import jit_physics
from graphrl_jax.ppo_config import PPOConfig, PPOHyper
from graphrl_jax.pretrain import PretrainConfig, PretrainData, PretrainHyper, PretrainState

# Share of the memory that is free which one program may take.
_SHARE = 0.6


def stack(members: Sequence[Any]) -> Any:
    """Pytrees of one structure as one, with a leading member axis; a single one stays as it is."""
    return members[0] if len(members) == 1 else jax.tree.map(lambda *leaves: jnp.stack(leaves), *members)


def unstack(tree: Any, count: int) -> list[Any]:
    """The inverse of `stack`."""
    return [tree] if count == 1 else [jax.tree.map(lambda leaf, i=i: leaf[i], tree) for i in range(count)]


def each(function: Callable, count: int) -> Callable:
    """`function` for `count` members side by side, its arguments and results as `stack` makes them."""
    return function if count == 1 else jax.vmap(function)


def in_turn(function: Callable, count: int) -> Callable:
    """As `each`, but one member after another, in the same program."""
    return function if count == 1 else lambda *stacked: jax.lax.map(lambda member: function(*member), stacked)


def pretrain_program(config: PretrainConfig, num_steps: int, count: int) -> Wrapped:
    """`num_steps` steps of `count` encoders: (hyper, data, state) -> (state, metrics); see `pretrain.run`.

    Members are shared out over the devices. Data stays where it is needed; every argument is as `stack` makes it.
    """
    where = devices.per_member(devices.mesh_for(count, len(jax.devices())), count)
    # A step of one member fits a CPU's caches, one of several does not: eight in turn take two thirds of the time.
    alone = jax.default_backend() == "cpu" and len(jax.devices()) == 1
    mapped = in_turn if alone else each

    def run(hyper: PretrainHyper, data: PretrainData, state: PretrainState) -> tuple[PretrainState, pretrain.Metrics]:
        return mapped(lambda *member: pretrain.run(config, *member, num_steps), count)(hyper, data, state)

    return jax.jit(run, in_shardings=where, out_shardings=where)


def policy_programs(config: PPOConfig, make_env: ppo.MakeEnv, count: int) -> tuple[Wrapped, Callable[[int], Wrapped]]:
    """Two programs for `count` policies, members and environments shared out over the devices.

    Returns:
      (reward_params, key) -> state, see `ppo.init`; and, for a number of updates, (hyper, reward_params, state) ->
      (state, metrics), see `ppo.updates`: the state is donated, and every device has all metrics.
    """
    mesh = devices.mesh_for(count, config.num_envs)
    member, state_lies = devices.per_member(mesh, count), devices.of_train_state(mesh, count)

    def init(reward_params: Any, key: jax.Array) -> ppo.TrainState:
        return each(partial(ppo.init, config, make_env), count)(reward_params, key)

    def updates(num_updates: int) -> Wrapped:
        def run(hyper: PPOHyper, reward_params: Any, state: ppo.TrainState) -> tuple[ppo.TrainState, ppo.Metrics]:
            return each(partial(ppo.updates, config, make_env, num_updates), count)(hyper, reward_params, state)

        return jit_physics(
            run,
            in_shardings=(member, member, state_lies),
            out_shardings=(state_lies, devices.everywhere(mesh)),
            donate_argnums=2,
        )

    return jit_physics(init, in_shardings=member, out_shardings=state_lies), updates


def free_bytes() -> int:
    """Memory of the device that is not taken; where the system does not say, as good as all there could be."""
    statistics = jax.devices()[0].memory_stats() if jax.default_backend() != "cpu" else None
    if statistics:
        return statistics["bytes_limit"] - statistics["bytes_in_use"]
    try:
        lines = Path("/proc/meminfo").read_text().splitlines()
    except OSError:
        return 1 << 40
    return next(1024 * int(line.split()[1]) for line in lines if line.startswith("MemAvailable"))


def fit(compile_for: Callable[[int], Any], members: int, budget: int | None = None) -> tuple[int, Any]:
    """The largest group of members whose program fits into memory.

    Args:
      compile_for: compiles the program for so many members (`jax.stages.Compiled`).
      members: how many there are.
      budget: bytes that the program may take; a share of what is free, if left out.

    Returns:
      members per group, and the program.
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


def groups(members: Sequence[Any], size: int) -> list[list[Any]]:
    """Groups of exactly `size`; the last one repeats its last member, so that one program runs them all."""
    cut = [list(members[start : start + size]) for start in range(0, len(members), size)]
    cut[-1] += cut[-1][-1:] * (size - len(cut[-1]))
    return cut
