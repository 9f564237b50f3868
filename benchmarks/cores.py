"""What training costs against its scale: CPU cores, environments, and policies of a sweep; and where its time goes.

    python -m benchmarks.cores [--cores 1 2] [--num-envs 64 256 1024 4096] [--members 1 2 4] [--repeats 7]

    cores     `benchmarks.throughput` on so many cores, in a process of its own that may use no others
    members   PPO's update of so many policies in one program on all cores, each with the fewest environments

The share of the time of an update in each of its parts follows from what each program does more than the one before it.
Only physics, by C MuJoCo, uses more than one core. So on paper, an update on c cores takes the time of all other parts,
and the c-th part of that of physics on one core. Writes cores.json and cores.png to `--out`'s folder.
"""

import math
import os
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import jax
import tyro
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks import throughput
from benchmarks.checks import refuse_below
from benchmarks.context import RESULTS, measured_on
from benchmarks.figures import plain, save
from benchmarks.timing import in_turns
from graphrl_jax.experiment import batching
from graphrl_jax.experiment.environments import TrainingParams, training_environment_of
from graphrl_jax.experiment.settings import compose
from graphrl_jax.registry import make_task
from graphrl_jax.rl import ppo
from graphrl_jax.runtime import configure
from graphrl_jax.storage import write_json

PARTS = {
    "physics": ("physics", None),
    "observation, reward of the task": ("environment", "physics"),
    "graph and encoder": ("reward", "environment"),
    "policy's actions, resets, bookkeeping": ("policy", "reward"),
    "gradient steps": ("ppo_graph", "policy"),
}
"""Parts of an update: the program that has it, and the one that lacks it alone."""
_ON_PAPER = (1, 2, 4, 8, 16, 32, 64)


@dataclass(frozen=True)
class Options:
    """Cost of training against its scale.

    Attributes:
      cores: numbers of CPU cores, 1 among them.
      num_envs: environments stepped together.
      members: policies in one program.
      steps: PPO's unroll length.
      repeats: timed calls of each program; the median counts.
      out: where the numbers go; a plot lies beside them.
    """

    cores: tuple[int, ...] = (1, 2)
    num_envs: tuple[int, ...] = (64, 256, 1024, 4096)
    members: tuple[int, ...] = (1, 2, 4)
    steps: int = 16
    repeats: int = 7
    out: Path = RESULTS / "cores.json"

    def __post_init__(self) -> None:
        refuse_below(self, cores=1, num_envs=1, members=1, steps=1, repeats=1)
        there = len(os.sched_getaffinity(0))
        if max(self.cores) > there or 1 not in self.cores:
            raise ValueError(f"cores is {self.cores}; allowed: 1, and others up to {there}, those of this machine")


def throughput_on(cores: int, options: Options) -> list[dict[str, Any]]:
    """The batches of `benchmarks.throughput` on so many cores."""
    programs = tuple(name for name, _ in PARTS.values() if name != "physics")
    asked = throughput.Options(
        programs=programs, num_envs=options.num_envs, steps=options.steps, repeats=options.repeats
    )
    allowed = sorted(os.sched_getaffinity(0))[:cores]
    return throughput.measured_apart(asked, preexec_fn=partial(os.sched_setaffinity, 0, allowed))["batches"]


def microseconds_of_parts(rates: Mapping[str, float]) -> dict[str, float]:
    """Microseconds per control step of each of `PARTS`, from the steps per second of programs."""
    micro = {name: 1e6 / rate for name, rate in rates.items()}
    return {part: micro[has] - (micro[lacks] if lacks else 0.0) for part, (has, lacks) in PARTS.items()}


def on_paper(parts: Mapping[str, float], cores: int) -> float:
    """Steps per second on so many cores, from the microseconds of parts on one core."""
    return 1e6 / (sum(parts.values()) - parts["physics"] * (1 - 1 / cores))


def side_by_side(options: Options) -> dict[str, float]:
    """Control steps per second of all policies together, by their number."""
    task = make_task("match_regions")
    num_envs = min(options.num_envs)
    minibatches = math.gcd(num_envs, compose(task, "graph").ppo_config.num_minibatches)
    sizes = {"num_envs": num_envs, "unroll_length": options.steps, "num_minibatches": minibatches}
    settings = compose(task, "graph", ppo=sizes)
    calls = {}
    for count in options.members:
        init, update = batching.policy_programs(settings.ppo_config, training_environment_of(task, "graph"), count)
        rewards = [throughput.random_reward(task, jax.random.key(member)) for member in range(count)]
        params = batching.stack([TrainingParams(ppo.as_float32(reward), None) for reward in rewards])
        keys = batching.stack([jax.random.key(member) for member in range(count)])
        hyper = batching.stack([ppo.as_float32(settings.ppo)] * count)
        state = init(params, keys)
        # The state is donated, so every call goes on from the one before.
        calls[count] = _Onward(partial(update(1), hyper, params), state)
    seconds = in_turns(calls, options.repeats)
    work = num_envs * options.steps
    return {str(count): count * work / statistics.median(found) for count, found in seconds.items()}


class _Onward:
    """A call that replaces its state by the result."""

    def __init__(self, update: Any, state: Any):
        self.update, self.state = update, state

    def __call__(self) -> None:
        self.state, _ = jax.block_until_ready(self.update(self.state))


def figure(found: Mapping[str, Any], path: Path) -> None:
    """Steps per second against cores, environments and members, and shares of an update's time."""
    drawn = Figure(figsize=(13, 3.4), dpi=120, layout="constrained")
    cores, envs, members, parts = drawn.subplots(1, 4)
    measured = found["cores"]
    many = max(measured, key=int)
    sizes = [batch["num_envs"] for batch in measured[many]]
    largest = {count: batches[-1]["ppo_graph"] for count, batches in measured.items()}
    cores.plot([int(count) for count in largest], list(largest.values()), "o", label="measured")
    cores.plot(_ON_PAPER, [found["on_paper"][str(count)] for count in _ON_PAPER], "--", label="on paper")
    for count, batches in measured.items():
        cores_used = "1 core" if count == "1" else f"{count} cores"
        envs.plot(sizes, [batch["ppo_graph"] for batch in batches], "-o", label=f"{cores_used}, PPO")
        envs.plot(sizes, [batch["physics"] for batch in batches], ":o", label=f"{cores_used}, physics")
    members.plot([int(count) for count in found["members"]], list(found["members"].values()), "-o")
    for axes, label in ((cores, "CPU cores"), (envs, "environments"), (members, "policies in one program")):
        axes.set(xlabel=label, ylabel="control steps per second", ylim=(0, None))
        axes.set_xscale("log", base=2)
        axes.xaxis.set_major_formatter("{x:g}")
        plain(axes)
    for axes in (cores, envs):
        axes.legend(frameon=False, fontsize=7)
    _bars(parts, measured[many])
    save(drawn, path)


def _bars(axes: Axes, batches: Sequence[Mapping[str, Any]]) -> None:
    """Shares of an update's time, a bar per number of environments."""
    names, bottom = [str(batch["num_envs"]) for batch in batches], [0.0] * len(batches)
    for part in PARTS:
        shares = [batch["microseconds"][part] / sum(batch["microseconds"].values()) for batch in batches]
        axes.bar(names, shares, bottom=bottom, label=part)
        bottom = [low + share for low, share in zip(bottom, shares, strict=True)]
    axes.set(xlabel="environments", ylabel="share of an update's time", ylim=(0, 1))
    plain(axes)
    axes.legend(frameon=False, fontsize=6, loc="upper left", bbox_to_anchor=(1, 1))


def main() -> None:
    """Measures, draws, prints and writes."""
    options = tyro.cli(Options, description=__doc__)
    where = measured_on("cores")
    measured = {}
    for count in options.cores:
        batches = [{"num_envs": batch["num_envs"], **_only(batch)} for batch in throughput_on(count, options)]
        measured[str(count)] = batches
    configure()
    found: dict[str, Any] = {"cores": measured, "members": side_by_side(options)}
    alone = measured["1"][-1]["microseconds"]
    found["on_paper"] = {str(count): on_paper(alone, count) for count in _ON_PAPER}
    about = {"members_num_envs": min(options.num_envs), "steps": options.steps, "repeats": options.repeats}
    write_json(options.out, {**found, **about, **where})
    figure(found, options.out.with_suffix(".png"))
    print(f"written: {options.out}")


def _only(batch: Mapping[str, Any]) -> dict[str, Any]:
    """The rates, parts and memory of a batch of one engine."""
    (engine,) = batch["engines"].values()
    rates = engine["steps_per_second"]
    memory = engine["memory_mib"]["ppo_graph"]
    return {**rates, "microseconds": microseconds_of_parts(rates), "memory_mib": memory}


if __name__ == "__main__":
    main()
