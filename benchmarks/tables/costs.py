"""Tables of time and memory: throughput, PyTorch, sweeps."""

from benchmarks.tables.cells import Result, of_result, table, where

LABELS = {
    "physics": "bare `mjx.step`, same scene and sub-steps",
    "environment": "environment step",
    "graph": "and the graph",
    "reward": "and the learned reward",
    "policy": "and resets, policy, bookkeeping (PPO's unroll)",
    "ppo_env": "PPO, environmental reward",
    "ppo_graph": "PPO, learned reward",
}
"""Of the programs of `benchmarks.throughput`."""


@of_result("throughput")
def throughput_table(result: Result) -> str:
    """Steps per second of training beside bare physics, and the ratios."""
    batches = result["batches"]
    sizes = [str(batch["num_envs"]) for batch in batches]
    columns = ["control steps/s (share of bare physics), by environments", *sizes, "compile (s)", "memory (MiB)"]
    rows = []
    for name, label in LABELS.items():
        cells = [f"{batch['steps_per_second'][name]:,.0f} ({batch['of_physics'][name]:.2f})" for batch in batches]
        largest = batches[-1]
        rows.append([label, *cells, f"{largest['compile_s'][name]:.0f}", f"{largest['memory_mib'][name]:,.0f}"])
    below = f"Compile time and memory with most environments {where(result)}"
    return table(columns, rows, below)


@of_result("pytorch")
def pytorch_table(result: Result) -> str:
    """Pretraining steps per second beside PyTorch's."""
    labels = {
        "jax": "here",
        "pytorch": f"PyTorch {result['torch']}, eager, all pairs in one tensor",
        "pytorch_pair_by_pair": "PyTorch, eager, pair by pair as XIRL's code",
    }
    rows = [
        [label, f"{result['steps_per_second'][name]:.1f}", f"{result['times_faster'][name]:.1f}"]
        for name, label in labels.items()
    ]
    columns = ["pretraining, same network, loss and batch", "steps/s", "time per step, here = 1"]
    return table(columns, rows, where(result))


@of_result("sweeps")
def sweeps_table(result: Result) -> str:
    """Time of a sweep's training beside that of as many separate runs."""
    columns = [
        "training, compiling included", "members", "together (s)", "one by one (s)", "ratio", "without compiling",
        "compiling: together, one by one (s)", "largest difference between their curves",
    ]  # fmt: skip
    labels = [f"encoders, {found['steps']} steps" for found in result["encoders"]] + ["policies, smoke size"]
    rows = []
    for label, found in zip(labels, [*result["encoders"], result["policies"]], strict=True):
        (together, alone), (one, many) = (
            (found[name]["together"], found[name]["alone"]) for name in ("seconds", "compiling")
        )
        rows.append(
            [label, str(found["members"]), f"{together:.0f}", f"{alone:.0f}", f"{together / alone:.2f}",
             f"{(together - one) / (alone - many):.2f}", f"{one:.0f}, {many:.0f}", f"{found['largest_difference']:.1e}"]
        )  # fmt: skip
    return table(columns, rows, where(result))
