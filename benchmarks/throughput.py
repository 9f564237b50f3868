"""Steps per second of training, beside the physics that it cannot do without.

    python -m benchmarks.throughput [--task shoes_in_box] [--engines mjx mujoco] [--num-envs 1 32 1024] [--repeats 11]
                                    [--before ../earlier]

In one process, on the same batches and starts, in control steps per second:

    physics       bare steps of the engine, as many sub-steps per control step as the task makes, under fixed controls
    environment   the task's `step` under fixed actions: physics, observation, reward and score
    graph         the same, and the graph of what is seen, with its activity
    reward        the same, and the learned reward of an encoder with random parameters (the time is the same)
    policy        PPO's unroll with the learned reward: the same with resets, drawn actions and bookkeeping
    ppo_env       PPO's whole update (unroll and all gradient steps) with the environment's reward
    ppo_graph     the same with the learned reward
    unguarded     the same without the guards against states and gradients that are not finite

PPO is that of `graphrl train`: networks, epochs, control steps per decision and starts are the task's for this device;
only the batch and the unroll's length are the options'. Each program is compiled, which is timed apart, then the
programs of all engines take turns, so that whatever else the machine does weighs on all of them. What counts are the
ratios of the medians; here a few hundredths are noise. Memory is what the compiled program asks for; the engine
`mujoco` keeps its own beside it. Compile times are those of a first run only if the compilation cache is empty
($JAX_COMPILATION_CACHE_DIR).

`--before` is a folder with the sources of an earlier commit, on which this is run first, in a process of its own.
"""

import math
import os
import statistics
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal

import jax
import jax.numpy as jnp
import tyro
from brax.envs.base import Env, State
from matplotlib.figure import Figure
from rich.console import Console
from rich.table import Table

from benchmarks.checks import refuse_below, refuse_no_checkout, refuse_unknown
from benchmarks.context import RESULTS, measured_on
from benchmarks.figures import plain, save
from benchmarks.tables.costs import LABELS, by_engine, label
from benchmarks.timing import compiled, in_turns, to_the_end
from benchmarks.unguarded import unguarded
from graphrl_jax.encoder import encoder
from graphrl_jax.encoder.config import EncoderConfig
from graphrl_jax.encoder.pooling import PoolingParams
from graphrl_jax.experiment.environments import TrainingParams, training_environment_of
from graphrl_jax.experiment.settings import compose
from graphrl_jax.graph import build_graph
from graphrl_jax.registry import ENGINES, make_task
from graphrl_jax.reward.model import RewardModel
from graphrl_jax.rl import ppo
from graphrl_jax.rl.wrappers import EnvironmentReward, GraphReward
from graphrl_jax.runtime import configure, default_preset, jit_physics
from graphrl_jax.storage import read_json, write_json
from graphrl_jax.task import Task
from tasks.engine import Dynamics, default_engine

Program = tuple[Any, tuple]
"""A function, and its arguments."""
_TAU = 0.01  # activity threshold; any value takes the same time


@dataclass(frozen=True)
class Options:
    """Throughput of physics, environment and training, in control steps per second.

    Attributes:
      task: match_regions, match_regions_layout or shoes_in_box.
      engines: physics engines, compared with the first one; the device's default if left out.
      programs: what is measured besides physics.
      num_envs: environments stepped together; each batch is measured.
      steps: the policy's decisions per call, PPO's unroll length.
      repeats: timed calls of each program; the median counts.
      before: folder of earlier sources.
      out: where the numbers go; a plot lies beside them. benchmarks/results/throughput[_TASK].json if left out.
    """

    task: Literal["match_regions", "match_regions_layout", "shoes_in_box"] = "match_regions"
    engines: tuple[str, ...] = ()
    programs: tuple[str, ...] = tuple(name for name in LABELS if name != "unguarded")
    num_envs: tuple[int, ...] = (1, 32, 1024)
    steps: int = 16
    repeats: int = 11
    before: Path | None = None
    out: Path | None = None

    def __post_init__(self) -> None:
        refuse_below(self, num_envs=1, steps=1, repeats=1)
        refuse_no_checkout("--before", self.before)
        refuse_unknown("--engines", self.engines, ENGINES)
        refuse_unknown("--programs", self.programs, LABELS)


def physics_program(task: Task, num_envs: int, steps: int, key: jax.Array) -> Program:
    """Bare physics: of the task's state, only positions, rates and the solver's start change."""
    reset_key, control_key = jax.random.split(key)
    controls = jax.random.uniform(control_key, (num_envs, task.mj_model.nu), minval=-0.5, maxval=0.5)

    def control(state: Any, ctrl: jax.Array) -> Any:
        dynamics = Dynamics(state.qpos, state.qvel, state.warmstart)
        after, _ = task.engine.step(dynamics, ctrl, task.fields(state), task.physics.substeps)
        return state._replace(**after._asdict())

    def run(states: Any) -> Any:
        def body(states: Any, _: None) -> tuple[Any, None]:
            return jax.vmap(control)(states, controls), None

        return jax.lax.scan(body, states, length=steps)[0]

    return run, (_reset(task, num_envs, reset_key).pipeline_state,)


def environment_program(env: Env, num_envs: int, steps: int, key: jax.Array, graph: bool = False) -> Program:
    """An environment's step under fixed actions; the task's own, or a wrapper's, with the graph of what is seen."""
    reset_key, action_key = jax.random.split(key)
    actions = jax.random.uniform(action_key, (num_envs, env.action_size), minval=-1.0, maxval=1.0)

    def look(state: State) -> jax.Array:
        """A number that needs all that is measured, so that no part of the step is dropped as unused."""
        if not graph:
            return state.reward
        info = state.info
        seen = build_graph(env.objects, info["boxes"], info["mask"], info["active"], info.get("class_ids"))
        return state.reward + sum(jnp.sum(leaf) for leaf in (seen.boxes, seen.classes, seen.active))

    def run(states: State) -> tuple[State, jax.Array]:
        def body(states: State, _: None) -> tuple[State, jax.Array]:
            states = jax.vmap(env.step)(states, actions)
            return states, jnp.mean(jax.vmap(look)(states))

        return jax.lax.scan(body, states, length=steps)

    return run, (_reset(env, num_envs, reset_key),)


def random_reward(task: Task, key: jax.Array) -> RewardModel:
    """A reward from an untrained encoder of the default size."""
    config = EncoderConfig()
    params = encoder.init(key, config, task.objects)
    pooling = PoolingParams(alpha=5.0, suppress_robot=1.0, robot_messages=1.0, tau=_TAU)
    floats = jax.tree.map(jnp.float32, (1.0, 0.8, pooling))
    return RewardModel(params, jnp.zeros(config.embedding), *floats)


def build_programs(
    task: Task, model: RewardModel, starts: Any, options: Options, num_envs: int, key: jax.Array
) -> dict[str, Program]:
    """Physics and the programs that are asked for, by name, on the starts that policies are trained on.

    Args:
      task: the task, with an engine.
      model: the learned reward.
      starts: as returned by `task.training_starts`.
      options: see `Options`.
      num_envs: environments stepped together.
      key: randomness.
    """
    physics_key, environment_key, ppo_key = jax.random.split(key, 3)
    settings = compose(task, "graph", default_preset())
    minibatches = math.gcd(num_envs, settings.ppo_config.num_minibatches)
    config = replace(settings.ppo_config, num_envs=num_envs, unroll_length=options.steps, num_minibatches=minibatches)
    hyper, reward_params = ppo.as_float32(settings.ppo), {"env": model.pooling, "graph": model}

    @cache
    def ppo_program(reward: str) -> Program:
        make_env, params = training_environment_of(task, reward), TrainingParams(reward_params[reward], starts)
        state = ppo.init_jit(config, make_env, params, ppo_key)
        return partial(ppo.update, config, make_env), (hyper, params, state)

    def unroll(params: TrainingParams, state: ppo.TrainState) -> tuple[Any, jax.Array]:
        env_state, data = ppo.unroll(config, training_environment_of(task, "graph"), params, state, state.key)
        return env_state, jnp.mean(data.reward)

    started, steps = task.training(starts), options.steps * config.decision_steps
    sizes = (num_envs, steps, environment_key)
    made: dict[str, Callable[[], Program]] = {
        "physics": lambda: physics_program(started, num_envs, steps, physics_key),
        "environment": lambda: environment_program(started, *sizes),
        "graph": lambda: environment_program(EnvironmentReward(started, model.pooling), *sizes, graph=True),
        "reward": lambda: environment_program(GraphReward(started, model), *sizes),
        "policy": lambda: (unroll, ppo_program("graph")[1][1:]),
        "ppo_env": lambda: ppo_program("env"),
        "ppo_graph": lambda: ppo_program("graph"),
        "unguarded": lambda: _without_guards(*ppo_program("graph")),
    }
    return {name: make() for name, make in made.items() if name in ("physics", *options.programs)}


def measure(programs: dict[str, dict[str, Program]], work: int, repeats: int) -> dict[str, dict[str, Any]]:
    """Rates, compile times and memory of every engine's programs, which make `work` control steps a call; by engine.

    The programs of all engines take turns.
    """
    calls, compile_s, memory = {}, {}, {}
    for engine, some in programs.items():
        for name, (function, arguments) in some.items():
            at = engine, name
            program, compile_s[at] = compiled(jit_physics(function), arguments)
            calls[at] = to_the_end(program, arguments)
            need = program.memory_analysis()
            memory[at] = (need.temp_size_in_bytes + need.argument_size_in_bytes + need.output_size_in_bytes) / 2**20
    seconds = in_turns(calls, repeats)
    medians = {at: statistics.median(found) for at, found in seconds.items()}

    def of_engine(engine: str) -> dict[str, Any]:
        names = programs[engine]
        return {
            "steps_per_second": {name: work / medians[engine, name] for name in names},
            "of_physics": {name: medians[engine, "physics"] / medians[engine, name] for name in names},
            "compile_s": {name: compile_s[engine, name] for name in names},
            "memory_mib": {name: memory[engine, name] for name in names},
            "seconds": {name: seconds[engine, name] for name in names},
        }

    return {engine: of_engine(engine) for engine in programs}


def of_first(engines: dict[str, dict[str, Any]]) -> dict[str, dict[str, float]]:
    """Rates of the other engines as multiples of the first one's, by engine and program."""
    rates = {engine: found["steps_per_second"] for engine, found in engines.items()}
    first, *others = rates
    return {engine: {name: rate / rates[first][name] for name, rate in rates[engine].items()} for engine in others}


def figure(batches: list[dict[str, Any]], path: Path) -> None:
    """Steps per second of every program against the batch; a line style for every engine."""
    drawn = Figure(figsize=(6, 4), dpi=120, layout="constrained")
    axes = drawn.subplots()
    found = [by_engine(batch) for batch in batches]
    sizes = [batch["num_envs"] for batch in batches]
    for engine, style in zip(found[0], ("-", "--", ":"), strict=False):
        for number, name in enumerate(found[0][engine]["steps_per_second"]):
            rates = [engines[engine]["steps_per_second"][name] for engines in found]
            shown = label(name, engine, len(found[0]) > 1).replace("`", "")
            axes.plot(sizes, rates, style, marker="o", color=f"C{number}", label=shown)
    axes.set(xscale="log", yscale="log", xlabel="environments", ylabel="control steps per second")
    plain(axes)
    axes.legend(frameon=False, fontsize=8 if len(found[0]) == 1 else 5)
    save(drawn, path)


def measured_apart(options: Options, **process: Any) -> dict[str, Any]:
    """What this benchmark measures in a process of its own, to which `subprocess.run` gives the arguments `process`."""
    with TemporaryDirectory() as folder:
        out = Path(folder) / "throughput.json"
        command = [sys.executable, "-m", "benchmarks.throughput", "--task", options.task, "--out", str(out)]
        lists = {"engines": options.engines, "programs": options.programs, "num-envs": options.num_envs}
        for name, values in lists.items():
            command += [f"--{name}", *map(str, values)] if values else []
        command += ["--steps", str(options.steps), "--repeats", str(options.repeats)]
        subprocess.run(command, check=True, **process)
        return read_json(out)


def measured_before(sources: Path, options: Options) -> dict[str, Any]:
    """What this benchmark measures on earlier sources."""
    with TemporaryDirectory() as folder:
        mixed = Path(folder)
        (mixed / "benchmarks").symlink_to(Path(__file__).absolute().parent)
        for package in ("graphrl_jax", "tasks"):
            (mixed / package).symlink_to((sources / package).absolute())
        return measured_apart(options, cwd=mixed, env={**os.environ, "PYTHONPATH": folder})


def main() -> None:
    """Measures, prints the table and writes JSON and plot, after every batch."""
    options = tyro.cli(Options, description=__doc__)
    before = measured_before(options.before, options) if options.before else None
    process_log = configure()
    where = measured_on("throughput")  # before anything else loads the machine
    end = "" if options.task == "match_regions" else f"_{options.task}"
    out = options.out or RESULTS / f"throughput{end}.json"
    tasks = {engine: make_task(options.task, engine) for engine in options.engines or (default_engine(),)}
    first = next(iter(tasks.values()))
    encoder_key, starts_key, key = jax.random.split(jax.random.key(0), 3)
    model = random_reward(first, encoder_key)
    starts = jit_physics(first.training_starts)(starts_key, model.pooling)
    batches: list[dict[str, Any]] = []
    for num_envs in options.num_envs:
        programs = {
            engine: build_programs(task, model, starts, options, num_envs, key) for engine, task in tasks.items()
        }
        engines = measure(programs, num_envs * options.steps * first.decision_steps, options.repeats)
        batches.append({"num_envs": num_envs, "engines": engines, "of_first_engine": of_first(engines)})
        context = {
            "task": options.task,
            "steps": options.steps,
            "decision_steps": first.decision_steps,
            "repeats": options.repeats,
            "compilation_cache": process_log.cache,
            **where,
        }
        if before:
            context["before"] = before
        write_json(out, {"batches": batches, **context})
        figure(batches, out.with_suffix(".png"))
        _print(batches[-1], context)


def _print(batch: dict[str, Any], context: dict[str, Any]) -> None:
    sizes = f"{batch['num_envs']} environments x {context['steps']} decisions of {context['decision_steps']} steps"
    table = Table(title=f"{sizes} on {context['device']}")
    for column in ("program", "control steps/s", "of physics", "compile (s)", "memory (MiB)", "of first engine"):
        table.add_column(column, justify="left" if column == "program" else "right", no_wrap=column == "program")
    for engine, found in batch["engines"].items():
        ratios = batch["of_first_engine"].get(engine, {})
        for name, rate in found["steps_per_second"].items():
            shown = (found["of_physics"][name], found["compile_s"][name], found["memory_mib"][name])
            ratio = f"{ratios[name]:.2f}" if name in ratios else ""
            cells = (f"{rate:,.0f}", f"{shown[0]:.2f}", f"{shown[1]:.1f}", f"{shown[2]:,.0f}", ratio)
            table.add_row(f"{engine}/{name}", *cells)
    Console().print(table)


def _without_guards(update: Callable, arguments: tuple) -> Program:
    return unguarded(update), arguments


def _reset(env: Env, num_envs: int, key: jax.Array) -> State:
    return jax.jit(jax.vmap(env.reset))(jax.random.split(key, num_envs))


if __name__ == "__main__":
    main()
