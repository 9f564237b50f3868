"""Pretraining steps per second beside PyTorch: the same network, the same loss, the same batches, in turns.

    pip install -e ".[bench]" && python -m benchmarks.pytorch

What is timed are optimiser steps (gradient of TCC and reconstruction, clipping, Adam), for JAX as `trainer.run` makes
them, for PyTorch eagerly, once with all pairs of sequences in one tensor and once pair by pair, as XIRL's released code
runs. Both are on the device that JAX finds, with the same formulas and, on a CPU, the same threads. Compared first are
the losses, before and after as many steps as a call makes. They take turns several steps at a time: right after the
other's, a step finds its threads still spinning. Writes benchmarks/results/pytorch.json (on a GPU: pytorch_gpu.json).
"""

import os
import statistics
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import torch  # pyright: ignore[reportMissingImports]
import tyro

from benchmarks.context import RESULTS, measured_on
from benchmarks.scaling import made_up_batch
from benchmarks.timing import in_turns
from graphrl_jax.graph import INPUT_SCALE, Graph, ObjectTable
from graphrl_jax.pretrain import trainer
from graphrl_jax.pretrain.config import PretrainConfig, PretrainHyper
from graphrl_jax.pretrain.trainer import PretrainState
from graphrl_jax.registry import make_task
from graphrl_jax.rl.ppo import as_float32
from graphrl_jax.runtime import configure
from graphrl_jax.storage import write_json

Batch = tuple[Graph, jax.Array, jax.Array]
"""Graphs (b, F, ...), frame mask (b, F) and times (b, F)."""


@dataclass(frozen=True)
class Options:
    """Steps per second of both.

    Attributes:
      repeats: timed calls of each; the median counts.
      steps: per call.
      seed: of parameters and batch.
    """

    repeats: int = 7
    steps: int = 20
    seed: int = 0


def jax_steps(config: PretrainConfig, hyper: PretrainHyper, state: Any, batches: list[Batch]) -> Callable[[], float]:
    """A call that goes on by a step per batch, in one program as in `trainer.run`, and returns the last loss."""

    @partial(jax.jit, donate_argnums=0)
    def run(state: PretrainState, batches: Batch) -> tuple[PretrainState, jax.Array]:
        def step(now: PretrainState, batch: Batch) -> tuple[PretrainState, jax.Array]:
            now, metrics = trainer.optimise(config, hyper, now, batch)
            return now, metrics["loss"]

        return jax.lax.scan(step, state, batches)

    now, stacked = [jax.tree.map(jnp.copy, state)], jax.tree.map(lambda *leaves: jnp.stack(leaves), *batches)

    def call() -> float:
        now[0], losses = run(now[0], stacked)
        return float(losses[-1])

    return call


def perceptron(layers: list[tuple[torch.Tensor, torch.Tensor]], inputs: torch.Tensor) -> torch.Tensor:
    """Linear layers with a ReLU between them."""
    for weight, bias in layers[:-1]:
        inputs = torch.relu(inputs @ weight + bias)
    return inputs @ layers[-1][0] + layers[-1][1]


def embed(params: dict[str, Any], graph: dict[str, torch.Tensor], hyper: PretrainHyper) -> tuple[torch.Tensor, ...]:
    """Node and graph embeddings of graphs (b, F, ...): messages factored as in `message_passing.py`, Eq. 1-2, head."""
    boxes, mask = graph["boxes"], graph["mask"]
    centres = INPUT_SCALE * boxes[..., :2]
    offsets = centres[..., None, :, :] - centres[..., :, None, :]
    distances = offsets.square().sum(-1, keepdim=True).clamp_min(1e-12).sqrt()
    others = mask[..., None, :] & ~torch.eye(mask.shape[-1], dtype=torch.bool, device=mask.device)
    weights = others.float() / others.float().sum(-1, keepdim=True).clamp_min(1.0)
    nodes = torch.relu(perceptron(params["input"], torch.cat([graph["classes"], INPUT_SCALE * (boxes - 0.5)], -1)))
    for layer in params["layers"]:
        places = centres @ layer["edge"][:2]
        pairs = (nodes @ layer["receiver"] + layer["message_bias"] - places)[..., :, None, :]
        pairs = pairs + (nodes @ layer["sender"] + places)[..., None, :, :] + distances * layer["edge"][2]
        messages = torch.einsum("...ij,...ijh->...ih", weights, torch.relu(pairs))
        update = torch.relu(nodes @ layer["own"] + messages @ layer["messages"] + layer["update_bias"])
        nodes = nodes + update @ layer["output"]
    shares = (1 + (float(hyper.alpha) - 1) * graph["active"].float()) * (~graph["robot"]).float() * mask.float()
    shares = shares / shares.sum(-1, keepdim=True)
    pooled = (shares[..., None] * nodes).sum(-2)
    return nodes, perceptron(params["head"], pooled)


def tcc(embeddings: torch.Tensor, times: torch.Tensor, temperature: float, pair_by_pair: bool) -> torch.Tensor:
    """Soft temporal cycle-consistency, `regression_mse`, of embeddings (b, F, D) over all ordered pairs."""
    count, _, size = embeddings.shape
    scale = 1 / (size * temperature)

    def logits(a: torch.Tensor, b: torch.Tensor) -> torch.Tensor:
        return 2 * scale * a @ b.transpose(-1, -2) - scale * b.square().sum(-1)[..., None, :]

    def cycle(u: torch.Tensor, v: torch.Tensor, u_times: torch.Tensor) -> torch.Tensor:
        nearest = torch.softmax(logits(u, v), -1) @ v
        back = torch.softmax(logits(nearest, u), -1)
        return ((back @ u_times[..., None])[..., 0] - u_times).square().mean(-1)

    if pair_by_pair:
        losses = [cycle(embeddings[i], embeddings[j], times[i]) for i in range(count) for j in range(count) if i != j]
        return torch.stack(losses).mean()
    first, second = torch.where(~torch.eye(count, dtype=torch.bool, device=times.device))
    return cycle(embeddings[first], embeddings[second], times[first]).mean()


def reconstruction(decoder: Any, nodes: torch.Tensor, graph: dict[str, torch.Tensor]) -> torch.Tensor:
    """Box error plus class cross-entropy, decoded from nodes; every slot of the batch is filled."""
    decoded = perceptron(decoder, nodes)
    boxes = (decoded[..., :4] - graph["boxes"]).square().mean()
    return boxes - (graph["classes"] * torch.log_softmax(decoded[..., 4:], -1)).sum(-1).mean()


def torch_steps(hyper: PretrainHyper, params: Any, batches: list[Batch], pair_by_pair: bool) -> Callable[[], float]:
    """The same in PyTorch."""
    device = "cpu" if jax.default_backend() == "cpu" else "cuda"
    leaves: list[torch.Tensor] = []

    def leaf(array: Any) -> torch.Tensor:
        leaves.append(torch.tensor(np.asarray(array), device=device, requires_grad=True))
        return leaves[-1]

    def layers(perceptron: Any) -> list[tuple[torch.Tensor, torch.Tensor]]:
        return [(leaf(layer["weight"]), leaf(layer["bias"])) for layer in perceptron]

    encoder = params["encoder"]
    ours = {
        "input": layers(encoder.input),
        "layers": [{name: leaf(value) for name, value in layer.items()} for layer in encoder.layers],
        "head": layers(encoder.head),
        "decoder": layers(params["decoder"]),
    }
    seen = [
        (
            {name: torch.tensor(np.asarray(value), device=device) for name, value in vars(graph).items()},
            torch.tensor(np.asarray(times), device=device),
        )
        for graph, _, times in batches
    ]
    optimizer = torch.optim.AdamW(leaves, lr=float(hyper.learning_rate), weight_decay=float(hyper.weight_decay))

    def loss(graph: dict[str, torch.Tensor], times: torch.Tensor) -> torch.Tensor:
        nodes, embeddings = embed(ours, graph, hyper)
        return float(hyper.tcc_weight) * tcc(embeddings, times, float(hyper.temperature), pair_by_pair) + float(
            hyper.reconstruction_weight
        ) * reconstruction(ours["decoder"], nodes, graph)

    def call() -> float:
        last = torch.tensor(0.0, device=device)
        for graph, times in seen:
            optimizer.zero_grad()
            last = loss(graph, times)
            last.backward()
            torch.nn.utils.clip_grad_norm_(leaves, float(hyper.max_grad_norm))
            optimizer.step()
        return last.item()

    return call


def steps_of(
    objects: ObjectTable, config: PretrainConfig, batches: list[Batch], seed: int
) -> dict[str, Callable[[], float]]:
    """All three by name: calls that go on by a step per batch from the same parameters at a steady learning rate."""
    hyper = as_float32(PretrainHyper(warmup=0.0, final_learning_rate=PretrainHyper().learning_rate))
    state = trainer.init(config, objects, jax.random.key(seed))
    return {
        "jax": jax_steps(config, hyper, state, batches),
        "pytorch": torch_steps(hyper, state.params, batches, False),
        "pytorch_pair_by_pair": torch_steps(hyper, state.params, batches, True),
    }


def main() -> None:
    """Compares the losses, measures, prints and writes."""
    options = tyro.cli(Options, description=__doc__)
    configure()
    torch.set_num_threads(len(os.sched_getaffinity(0)))
    where = measured_on("pytorch") | {"torch": torch.__version__, "threads": torch.get_num_threads()}
    objects, config = make_task("match_regions").objects, PretrainConfig()
    batches = [made_up_batch(config, objects, options.seed + i) for i in range(options.steps)]
    losses = {
        f"after_{count}_steps": {name: call() for name, call in steps_of(objects, config, some, options.seed).items()}
        for count, some in ((1, batches[:1]), (options.steps, batches))
    }
    for found in losses.values():
        np.testing.assert_allclose(list(found.values()), found["jax"], rtol=1e-2)
    calls = steps_of(objects, config, batches, options.seed)
    seconds = {
        name: [taken / options.steps for taken in times] for name, times in in_turns(calls, options.repeats).items()
    }
    medians = {name: statistics.median(found) for name, found in seconds.items()}
    report = {
        "steps_per_second": {name: 1 / median for name, median in medians.items()},
        "times_faster": {name: median / medians["jax"] for name, median in medians.items()},
        "losses": losses,
        "batch": [config.batch_size, config.num_frames, objects.num_slots],
        "seconds": seconds,
        **where,
    }
    write_json(RESULTS / ("pytorch.json" if jax.default_backend() == "cpu" else "pytorch_gpu.json"), report)
    print({name: round(value, 2) for name, value in report["times_faster"].items()})


if __name__ == "__main__":
    main()
