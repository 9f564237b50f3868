"""Steps per second of training, beside the physics that it cannot do without.

    python -m benchmarks.throughput [--task match_regions] [--num-envs 1 32 1024] [--steps 16] [--repeats 11]

In one process, on the same batches, in environment (control) steps per second:

    physics       bare `mjx.step`, as many sub-steps per control step as the task makes, under fixed controls
    environment   the task's `step` under fixed actions: physics, observation, reward and score
    graph         the same, and the graph of what is seen, with its activity
    reward        the same, and the learned reward of an encoder with random parameters (the time is the same)
    policy        PPO's unroll with the learned reward: the same with resets, drawn actions and bookkeeping
    ppo_env       PPO's whole update (unroll and all gradient steps) with the environment's reward
    ppo_graph     the same with the learned reward

Each is compiled, which is timed apart, then they take turns, so that whatever else the machine does weighs on all of
them. What counts are the ratios of the medians; here a few hundredths are noise. Memory is what the compiled program
asks for. Compile times are those of a first run only if the compilation cache is empty ($JAX_COMPILATION_CACHE_DIR).
"""

import math
import statistics
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal

import jax
import jax.numpy as jnp
import tyro
from brax.envs.base import Env, State
from matplotlib.figure import Figure
from mujoco import mjx
from rich.console import Console
from rich.table import Table

from benchmarks.checks import refuse_below
from benchmarks.context import RESULTS, measured_on
from benchmarks.figures import plain, save
from benchmarks.tables.costs import LABELS
from benchmarks.timing import compiled, in_turns, to_the_end
from graphrl_jax.encoder import encoder
from graphrl_jax.encoder.config import EncoderConfig
from graphrl_jax.encoder.pooling import PoolingParams
from graphrl_jax.graph import build_graph
from graphrl_jax.registry import make_task
from graphrl_jax.reward.model import RewardModel
from graphrl_jax.rl import ppo
from graphrl_jax.rl.config import PPOConfig, PPOHyper
from graphrl_jax.rl.wrappers import EnvironmentReward, GraphReward
from graphrl_jax.runtime import configure, jit_physics
from graphrl_jax.storage import write_json
from graphrl_jax.task import Task

_TAU = 0.01  # activity threshold; any value takes the same time


@dataclass(frozen=True)
class Options:
    """Throughput of physics, environment and training, in environment steps per second.

    Attributes:
      task: match_regions or shoes_in_box.
      num_envs: environments stepped together; each batch is measured.
      steps: control steps per call, PPO's unroll length.
      repeats: timed calls of each program; the median counts.
      out: where the numbers go; a plot lies beside them. benchmarks/results/throughput[_shoes_in_box].json if left out.
    """

    task: Literal["match_regions", "shoes_in_box"] = "match_regions"
    num_envs: tuple[int, ...] = (1, 32, 1024)
    steps: int = 16
    repeats: int = 11
    out: Path | None = None

    def __post_init__(self) -> None:
        refuse_below(self, num_envs=1, steps=1, repeats=1)


def physics_program(task: Task, num_envs: int, steps: int, key: jax.Array) -> tuple[Any, tuple]:
    """Bare physics: as in the task, only positions, rates and the solver's start are carried."""
    model, template = task._model, task._template
    reset_key, control_key = jax.random.split(key)
    controls = jax.random.uniform(control_key, (num_envs, model.nu), minval=-0.5, maxval=0.5)

    def substep(state: Any, control: jax.Array) -> Any:
        data = template.replace(qpos=state.qpos, qvel=state.qvel, qacc_warmstart=state.warmstart, ctrl=control)
        data = mjx.step(model, data)
        return state._replace(qpos=data.qpos, qvel=data.qvel, warmstart=data.qacc_warmstart)

    def run(states: Any) -> Any:
        def body(states: Any, _: None) -> tuple[Any, None]:
            return jax.vmap(substep)(states, controls), None

        return jax.lax.scan(body, states, length=steps * task.physics.substeps)[0]

    return run, (_reset(task, num_envs, reset_key).pipeline_state,)


def environment_program(env: Env, num_envs: int, steps: int, key: jax.Array, graph: bool = False) -> tuple[Any, tuple]:
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


def build_programs(options: Options, num_envs: int, key: jax.Array) -> dict[str, tuple[Any, tuple]]:
    """The programs by name, as functions and their arguments, on the starts that policies are trained on."""
    task = make_task(options.task).training()
    physics_key, environment_key, encoder_key, ppo_key = jax.random.split(key, 4)
    sizes = (num_envs, options.steps, environment_key)
    model = random_reward(task, encoder_key)
    minibatches = math.gcd(num_envs, 16)
    config = PPOConfig(
        num_envs=num_envs, unroll_length=options.steps, num_minibatches=minibatches, episode_length=task.episode_length
    )
    make_env, make_graph = partial(EnvironmentReward, task), partial(GraphReward, task)
    tau = jnp.float32(_TAU)

    def unroll(state: ppo.TrainState) -> tuple[Any, jax.Array]:
        env_state, data = ppo.unroll(config, make_graph, model, state, state.key)
        return env_state, jnp.mean(data.reward)

    start = partial(ppo.init_jit, config)
    env_state, graph_state = start(make_env, tau, ppo_key), start(make_graph, model, ppo_key)
    return {
        "physics": physics_program(task, num_envs, options.steps, physics_key),
        "environment": environment_program(task, *sizes),
        "graph": environment_program(EnvironmentReward(task, tau), *sizes, graph=True),
        "reward": environment_program(GraphReward(task, model), *sizes),
        "policy": (unroll, (graph_state,)),
        "ppo_env": (partial(ppo.update, config, make_env, PPOHyper(), tau), (env_state,)),
        "ppo_graph": (partial(ppo.update, config, make_graph, PPOHyper(), model), (graph_state,)),
    }


def measure(programs: dict[str, tuple[Any, tuple]], work: int, repeats: int) -> dict[str, Any]:
    """Rates (environment steps per second), compile times and memory of programs that make `work` steps a call."""
    calls, compile_s, memory = {}, {}, {}
    for name, (function, arguments) in programs.items():
        program, compile_s[name] = compiled(jit_physics(function), arguments)
        calls[name] = to_the_end(program, arguments)
        need = program.memory_analysis()
        memory[name] = (need.temp_size_in_bytes + need.argument_size_in_bytes + need.output_size_in_bytes) / 2**20
    seconds = in_turns(calls, repeats)
    medians = {name: statistics.median(found) for name, found in seconds.items()}
    return {
        "steps_per_second": {name: work / median for name, median in medians.items()},
        "of_physics": {name: medians["physics"] / median for name, median in medians.items()},
        "compile_s": compile_s,
        "memory_mib": memory,
        "seconds": seconds,
    }


def figure(batches: list[dict[str, Any]], path: Path) -> None:
    """Steps per second of every program against the batch."""
    drawn = Figure(figsize=(6, 4), dpi=120, layout="constrained")
    axes = drawn.subplots()
    for name, label in LABELS.items():
        rates = [batch["steps_per_second"][name] for batch in batches]
        axes.plot([batch["num_envs"] for batch in batches], rates, marker="o", label=label.replace("`", ""))
    axes.set(xscale="log", yscale="log", xlabel="environments", ylabel="environment steps per second")
    plain(axes)
    axes.legend(frameon=False, fontsize=8)
    save(drawn, path)


def main() -> None:
    """Measures, prints the table and writes JSON and plot, after every batch."""
    options = tyro.cli(Options, description=__doc__)
    process_log = configure()
    where = measured_on("throughput")  # before anything else loads the machine
    end = "" if options.task == "match_regions" else f"_{options.task}"
    out = options.out or RESULTS / f"throughput{end}.json"
    batches: list[dict[str, Any]] = []
    for num_envs in options.num_envs:
        programs = build_programs(options, num_envs, jax.random.key(0))
        batches.append({"num_envs": num_envs, **measure(programs, num_envs * options.steps, options.repeats)})
        context = {
            "task": options.task,
            "steps": options.steps,
            "repeats": options.repeats,
            "compilation_cache": process_log.cache,
            **where,
        }
        write_json(out, {"batches": batches, **context})
        figure(batches, out.with_suffix(".png"))
        _print(batches[-1], context)


def _print(batch: dict[str, Any], context: dict[str, Any]) -> None:
    table = Table(title=f"{batch['num_envs']} environments x {context['steps']} steps on {context['device']}")
    for column in ("program", "steps/s (median)", "of physics", "compile (s)", "memory (MiB)"):
        table.add_column(column, justify="left" if column == "program" else "right")
    for name, rate in batch["steps_per_second"].items():
        shown = (batch["of_physics"][name], batch["compile_s"][name], batch["memory_mib"][name])
        table.add_row(name, f"{rate:,.0f}", f"{shown[0]:.2f}", f"{shown[1]:.1f}", f"{shown[2]:,.0f}")
    Console().print(table)


def _reset(env: Env, num_envs: int, key: jax.Array) -> State:
    return jax.jit(jax.vmap(env.reset))(jax.random.split(key, num_envs))


if __name__ == "__main__":
    main()
