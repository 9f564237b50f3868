"""Steps per second of training, beside the physics that it cannot do without.

    python -m benchmarks.throughput [--num-envs 1024] [--steps 16] [--repeats 3] [--out FILE]

In one process, on the same batch, in environment (control) steps per second:

    physics       bare `mjx.step`, as many sub-steps per control step as the task makes, under fixed controls
    environment   the task's `step` under fixed actions: physics, observation, reward and score
    ppo_env       PPO's whole update (unroll and all gradient steps) with the environment's reward
    ppo_graph     the same with the learned reward, of an encoder with random parameters (the time is the same)

The first call of each is timed apart (it traces and compiles), then the four take turns, so that whatever else the
machine does weighs on all of them. What counts are the ratios of the medians.
"""

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import tyro
from mujoco import mjx
from rich.console import Console
from rich.table import Table

from benchmarks.context import measured_on
from graphrl_jax import encoder, ppo
from graphrl_jax.compilation import configure, jit_physics
from graphrl_jax.ppo_config import PPOConfig, PPOHyper
from graphrl_jax.reward import RewardModel
from graphrl_jax.runs import write_json
from graphrl_jax.wrappers import EnvironmentReward, GraphReward
from tasks.match_regions.env import MatchRegions
from tasks.match_regions.state import PhysicsState

RATIOS = (("ppo_env", "physics"), ("ppo_env", "environment"), ("ppo_graph", "ppo_env"))
_TAU = 0.01  # activity threshold; any value takes the same time

Program = Callable[[], Any]


@dataclass(frozen=True)
class Options:
    """Throughput of physics, environment and training, in environment steps per second.

    Attributes:
      num_envs: environments stepped together.
      steps: control steps per call, PPO's unroll length.
      repeats: timed calls of each program; the median counts.
      out: where the numbers go.
    """

    num_envs: int = 1024
    steps: int = 16
    repeats: int = 11
    out: Path = Path("benchmarks/results/throughput.json")

    def __post_init__(self) -> None:
        for name in ("num_envs", "steps", "repeats"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} is {getattr(self, name)}; allowed: 1 or more")


def physics_program(task: MatchRegions, options: Options, key: jax.Array) -> Program:
    """Bare physics at its fastest: as in the task, only positions, rates and the solver's start are carried."""
    model, template = task._model, task._template
    reset_key, control_key = jax.random.split(key)
    controls = jax.random.uniform(control_key, (options.num_envs, model.nu), minval=-0.5, maxval=0.5)

    def substep(state: PhysicsState, control: jax.Array) -> PhysicsState:
        data = template.replace(qpos=state.qpos, qvel=state.qvel, qacc_warmstart=state.warmstart, ctrl=control)
        data = mjx.step(model, data)
        return state._replace(qpos=data.qpos, qvel=data.qvel, warmstart=data.qacc_warmstart)

    @jit_physics
    def run(states: PhysicsState) -> PhysicsState:
        def body(states: PhysicsState, _: None) -> tuple[PhysicsState, None]:
            return jax.vmap(substep)(states, controls), None

        return jax.lax.scan(body, states, length=options.steps * task.physics.substeps)[0]

    return partial(run, _reset(task, options, reset_key).pipeline_state)


def environment_program(task: MatchRegions, options: Options, key: jax.Array) -> Program:
    """The task's own step, without wrappers."""
    reset_key, action_key = jax.random.split(key)
    actions = jax.random.uniform(action_key, (options.num_envs, task.action_size), minval=-1.0, maxval=1.0)

    @jit_physics
    def run(states: Any) -> Any:
        def body(states: Any, _: None) -> tuple[Any, jax.Array]:
            states = jax.vmap(task.step)(states, actions)
            # Handed out, so that no part of the step is dropped as unused.
            return states, jnp.mean(states.reward)

        return jax.lax.scan(body, states, length=options.steps)

    return partial(run, _reset(task, options, reset_key))


def ppo_program(make_env: ppo.MakeEnv, reward_params: Any, options: Options, key: jax.Array) -> Program:
    """One update of PPO per call, going on from where the last call ended (its state is donated)."""
    config = PPOConfig(num_envs=options.num_envs, unroll_length=options.steps)
    hyper = PPOHyper()
    state = ppo.init_jit(config, make_env, reward_params, key)

    def run() -> Any:
        nonlocal state
        state, metrics = ppo.train_chunk(config, make_env, hyper, reward_params, state, 1)
        return state, metrics

    return run


def random_reward(task: MatchRegions, key: jax.Array) -> RewardModel:
    """A reward from an untrained encoder of the default size."""
    config = encoder.EncoderConfig()
    params = encoder.init(key, config, task.objects.num_classes)
    scalars = (jnp.float32(value) for value in (1.0, 0.8, 5.0, 1.0, _TAU, 1.0))
    return RewardModel(params, jnp.zeros(config.embedding), *scalars)


def build_programs(options: Options, key: jax.Array) -> dict[str, Program]:
    """The four programs by name, on the starts that policies are trained on. Resets are compiled here."""
    task = MatchRegions().training()
    physics_key, environment_key, encoder_key, ppo_key = jax.random.split(key, 4)
    return {
        "physics": physics_program(task, options, physics_key),
        "environment": environment_program(task, options, environment_key),
        "ppo_env": ppo_program(partial(EnvironmentReward, task), jnp.float32(_TAU), options, ppo_key),
        "ppo_graph": ppo_program(partial(GraphReward, task), random_reward(task, encoder_key), options, ppo_key),
    }


def measure(programs: dict[str, Program], repeats: int) -> tuple[dict[str, float], dict[str, list[float]]]:
    """Seconds of the first call of each program, and of `repeats` later ones taken in turns."""
    first = {name: _seconds(program) for name, program in programs.items()}
    later: dict[str, list[float]] = {name: [] for name in programs}
    for _ in range(repeats):
        for name, program in programs.items():
            later[name].append(_seconds(program))
    return first, later


def summarise(options: Options, first: dict[str, float], later: dict[str, list[float]]) -> dict[str, Any]:
    """Rates (environment steps per second), compile times and the ratios of the rates."""
    work = options.num_envs * options.steps
    medians = {name: statistics.median(seconds) for name, seconds in later.items()}
    return {
        "ratios": {f"{a} / {b}": medians[b] / medians[a] for a, b in RATIOS},
        "steps_per_second": {name: work / seconds for name, seconds in medians.items()},
        "compile_s": {name: max(first[name] - medians[name], 0.0) for name in medians},
        "seconds": later,
    }


def main() -> None:
    """Measures, prints the table and writes the JSON."""
    options = tyro.cli(Options, description=__doc__)
    compile_log = configure()
    where = measured_on("throughput")  # before anything else loads the machine
    results = summarise(options, *measure(build_programs(options, jax.random.key(0)), options.repeats))
    context = {
        "num_envs": options.num_envs,
        "steps": options.steps,
        "repeats": options.repeats,
        "substeps": MatchRegions().physics.substeps,
        "compilation_cache": compile_log.cache,
        **where,
    }
    write_json(options.out, {**results, **context})
    _print(options, results, context)


def _print(options: Options, results: dict[str, Any], context: dict[str, Any]) -> None:
    table = Table(title=f"{options.num_envs} environments x {options.steps} steps on {context['device']}")
    for column in ("program", "steps/s (median)", "compile (s)"):
        table.add_column(column, justify="left" if column == "program" else "right")
    for name, rate in results["steps_per_second"].items():
        table.add_row(name, f"{rate:,.0f}", f"{results['compile_s'][name]:.1f}")
    console = Console()
    console.print(table)
    for name, ratio in results["ratios"].items():
        console.print(f"{name}: {ratio:.2f}")
    console.print(f"compilation cache: {context['compilation_cache']}; written to {options.out}")


def _reset(task: MatchRegions, options: Options, key: jax.Array) -> Any:
    return jax.jit(jax.vmap(task.reset))(jax.random.split(key, options.num_envs))


def _seconds(program: Program) -> float:
    start = time.perf_counter()
    jax.block_until_ready(program())
    return time.perf_counter() - start


if __name__ == "__main__":
    main()
