"""What encoders cost against their sizes: node slots N, frames T, members K.

    python -m benchmarks.scaling [--nodes 8 16 32 64] [--frames 20 40 80] [--members 1 2 4 8 15] [--repeats 7]

    nodes     embedding a graph, as an environment's step does, and an optimiser's step, against N
    frames    an optimiser's step against the frames T of each demonstration
    members   an optimiser's step of K encoders in one program, side by side and in turn, against K

Time is per graph, per step and per member's step, on made-up batches of the default sizes. Writes scaling.json and a
plot to `--out`'s folder.
"""

import statistics
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import tyro
from matplotlib.figure import Figure

from benchmarks.checks import refuse_below
from benchmarks.context import measured_on
from benchmarks.figures import plain, save
from benchmarks.timing import compiled, in_turns, to_the_end
from graphrl_jax.encoder import encoder
from graphrl_jax.encoder.config import EncoderConfig
from graphrl_jax.encoder.pooling import PoolingParams
from graphrl_jax.experiment import batching
from graphrl_jax.graph import Graph, ObjectTable
from graphrl_jax.pretrain import trainer
from graphrl_jax.pretrain.config import PretrainConfig, PretrainHyper
from graphrl_jax.rl.ppo import as_float32
from graphrl_jax.runtime import configure
from graphrl_jax.storage import write_json

Mapping = Callable[[Callable, int], Callable]

GRAPHS = 1024
CLASSES = 8


@dataclass(frozen=True)
class Options:
    """Cost of encoders against their sizes.

    Attributes:
      nodes: numbers of node slots.
      frames: numbers of frames per demonstration.
      members: numbers of encoders in one program.
      repeats: timed calls of each program; the median counts.
      out: where the numbers go; a plot lies beside them.
    """

    nodes: tuple[int, ...] = (8, 16, 32, 64)
    frames: tuple[int, ...] = (20, 40, 80)
    members: tuple[int, ...] = (1, 2, 4, 8, 15)
    repeats: int = 7
    out: Path = Path("benchmarks/results/scaling.json")

    def __post_init__(self) -> None:
        refuse_below(self, nodes=2, frames=2, members=1, repeats=1)


def table_of(num_slots: int) -> ObjectTable:
    """A robot and other objects of eight classes."""
    return ObjectTable(
        names=tuple(f"object {i}" for i in range(num_slots)),
        class_ids=tuple(i % CLASSES for i in range(num_slots)),
        is_robot=(True,) + (False,) * (num_slots - 1),
        class_names=tuple(f"class {i}" for i in range(CLASSES)),
    )


def made_up_graphs(objects: ObjectTable, shape: tuple[int, ...], seed: int) -> Graph:
    """Graphs (*shape, N, ...) with all slots filled and boxes anywhere."""
    random = np.random.default_rng(seed)
    shape = (*shape, objects.num_slots)
    classes = np.eye(objects.num_classes, dtype=np.float32)[np.array(objects.class_ids)]
    return jax.tree.map(
        jnp.asarray,
        Graph(
            boxes=random.uniform(0, 1, (*shape, 4)).astype(np.float32),
            mask=np.ones(shape, bool),
            classes=np.broadcast_to(classes, (*shape, objects.num_classes)),
            robot=np.broadcast_to(np.array(objects.is_robot), shape),
            active=random.uniform(size=shape) < 0.5,
        ),
    )


def made_up_batch(config: PretrainConfig, objects: ObjectTable, seed: int) -> tuple[Graph, jax.Array, jax.Array]:
    """A batch for an optimiser's step: graphs (b, F, ...), frame mask (b, F) and times (b, F)."""
    shape = (config.batch_size, config.num_frames)
    times = np.sort(np.random.default_rng(seed).uniform(size=shape).astype(np.float32), axis=1)
    return made_up_graphs(objects, shape, seed), jnp.ones(shape, bool), jnp.asarray(times)


def timed(function: Callable, arguments: tuple, repeats: int) -> dict[str, float]:
    """Seconds that a call takes (the median), and that compiling takes."""
    program, compile_s = compiled(jax.jit(function), arguments)
    seconds = in_turns({"call": to_the_end(program, arguments)}, repeats)["call"]
    return {"seconds": statistics.median(seconds), "compile_s": compile_s}


def embedding(num_slots: int, repeats: int) -> dict[str, float]:
    """Embedding a batch of graphs."""
    objects = table_of(num_slots)
    params = encoder.init(jax.random.key(0), EncoderConfig(), objects)
    graphs = made_up_graphs(objects, (GRAPHS,), 0)
    return timed(jax.vmap(encoder.encode, in_axes=(None, 0, None)), (params, graphs, PoolingParams()), repeats)


def optimising(
    config: PretrainConfig, num_slots: int, repeats: int, members: int = 1, mapped: Mapping = batching.each
) -> dict[str, float]:
    """An optimiser's step of some members."""
    objects, hyper = table_of(num_slots), as_float32(PretrainHyper())
    states = [trainer.init(config, objects, jax.random.key(seed)) for seed in range(members)]
    batches = [made_up_batch(config, objects, seed) for seed in range(members)]

    def step(state: trainer.PretrainState, batch: Any) -> trainer.PretrainState:
        return trainer.optimise(config, hyper, state, batch)[0]

    return timed(mapped(step, members), (batching.stack(states), batching.stack(batches)), repeats)


def measure(options: Options) -> dict[str, dict[int, dict[str, float]]]:
    """Seconds by what is varied and by its size, per graph and per member where there are several."""
    config, repeats = PretrainConfig(), options.repeats
    found = {
        "embedding": {count: embedding(count, repeats) for count in options.nodes},
        "step_nodes": {count: optimising(config, count, repeats) for count in options.nodes},
        "step_frames": {
            count: optimising(replace(config, num_frames=count), CLASSES, repeats) for count in options.frames
        },
        "side_by_side": {count: optimising(config, CLASSES, repeats, count) for count in options.members},
        "in_turn": {count: optimising(config, CLASSES, repeats, count, batching.in_turn) for count in options.members},
    }
    for row in found["embedding"].values():
        row["seconds"] /= GRAPHS
    for name in ("side_by_side", "in_turn"):
        for count, row in found[name].items():
            row["seconds"] /= count
    return found


PANELS = {
    "embedding": ("node slots N", "microseconds per graph", 1e6),
    "step_nodes": ("node slots N", "milliseconds per step", 1e3),
    "step_frames": ("frames T", "milliseconds per step", 1e3),
    "side_by_side": ("members K side by side", "milliseconds per member's step", 1e3),
    "in_turn": ("members K in turn", "milliseconds per member's step", 1e3),
}


def figure(found: dict[str, dict[int, dict[str, float]]], path: Path) -> None:
    """A panel for each size."""
    drawn = Figure(figsize=(14, 3), dpi=120, layout="constrained")
    for axes, (name, (label, unit, scale)) in zip(drawn.subplots(1, len(PANELS)), PANELS.items(), strict=True):
        rows = found[name]
        axes.plot(list(rows), [scale * row["seconds"] for row in rows.values()], marker="o")
        axes.set(xlabel=label, ylabel=unit, ylim=(0, None), xticks=list(rows))
        plain(axes)
    save(drawn, path)


def main() -> None:
    """Measures, prints and writes."""
    options = tyro.cli(Options, description=__doc__)
    configure()
    where = measured_on("scaling")
    found = measure(options)
    for name, rows in found.items():
        label, unit, scale = PANELS[name]
        print(f"{label}, {unit}:", {count: round(scale * row["seconds"], 2) for count, row in rows.items()})
    write_json(options.out, {"costs": found, **where})
    figure(found, options.out.with_suffix(".png"))


if __name__ == "__main__":
    main()
