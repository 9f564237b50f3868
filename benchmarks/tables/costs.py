"""Tables of time and memory: throughput, PyTorch, sweeps."""

from typing import Any

from benchmarks.tables.cells import Result, commit, of_result, table, where

LABELS = {
    "physics": "bare {step}, same scene and sub-steps",
    "environment": "environment step",
    "graph": "and the graph",
    "reward": "and the learned reward",
    "policy": "and resets, policy, bookkeeping (PPO's unroll)",
    "ppo_env": "PPO, environmental reward",
    "ppo_graph": "PPO, learned reward",
    "unguarded": "PPO, learned reward, no guards",
}
"""Of the programs of `benchmarks.throughput`."""
TASKS = {
    "match_regions": "Match Regions",
    "match_regions_layout": "Match Regions, layout",
    "shoes_in_box": "Shoes in Box",
}
"""Of `benchmarks.throughput`."""
_STEPS = {"mjx": "`mjx.step`", "mujoco": "`mujoco.batch`", "warp": "`mjx.step` in Warp"}


def label(program: str, engine: str, named: bool) -> str:
    """What a program is called, with its engine if that is to be `named`."""
    shown = LABELS[program].format(step=_STEPS[engine])
    return f"{engine}: {shown}" if named else shown


def by_engine(batch: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """The measurements of a batch by engine; files of earlier releases, with MJX alone, do not name it."""
    return batch.get("engines", {"mjx": batch})


def throughput_of(result: Result) -> str:
    """Steps per second of training beside bare physics, and the ratios."""
    batches = [by_engine(batch) for batch in result["batches"]]
    sizes = [str(batch["num_envs"]) for batch in result["batches"]]
    columns = [
        f"{TASKS[result['task']]}: control steps/s (share of bare physics), by environments",
        *sizes,
        "compile (s)",
        "memory (MiB)",
    ]
    rows = []
    for engine, largest in batches[-1].items():
        for name in largest["steps_per_second"]:
            found = [batch[engine] for batch in batches]
            cells = [_rate(one, name) for one in found]
            costs = f"{largest['compile_s'][name]:.0f}", f"{largest['memory_mib'][name]:,.0f}"
            rows.append([label(name, engine, len(batches[-1]) > 1), *cells, *costs])
    below = f"Compile time and memory with most environments {where(result)}"
    return table(columns, rows + _ratios(result["batches"]), below)


def _rate(found: dict[str, Any], program: str) -> str:
    """Steps per second of a program of one engine, and its share of bare physics."""
    return f"{found['steps_per_second'][program]:,.0f} ({found['of_physics'][program]:.2f})"


def _ratios(batches: list[dict[str, Any]]) -> list[list[str]]:
    """A row for every engine but the first: how many times as fast PPO is with it."""
    first = next(iter(by_engine(batches[-1])))
    return [
        [f"{LABELS['ppo_graph']}: {engine} / {first}", *(_ratio(batch, engine) for batch in batches), "", ""]
        for engine, ratios in batches[-1].get("of_first_engine", {}).items()
        if "ppo_graph" in ratios
    ]


def _ratio(batch: dict[str, Any], engine: str) -> str:
    return f"{batch['of_first_engine'][engine]['ppo_graph']:.2f}"


def speedup_of(result: Result) -> str:
    """Steps per second and shares of bare physics of an earlier commit, and now, with most environments."""
    if "before" not in result:
        return ""
    earlier = result["before"]
    before, now = (by_engine(found["batches"][-1]) for found in (earlier, result))
    rows = []
    for engine in now:
        for name, rate in now[engine]["steps_per_second"].items():
            cells = [_rate(one[engine], name) for one in (before, now)]
            faster = rate / before[engine]["steps_per_second"][name]
            rows.append([label(name, engine, len(now) > 1), *cells, f"{faster:.2f}"])
    first = f"{TASKS[result['task']]}: control steps/s (share of bare physics)"
    columns = [first, f"commit {commit(earlier)}", f"commit {commit(result)}", "times as fast"]
    below = f"{result['batches'][-1]['num_envs']} environments, one commit after the other {where(result)}"
    return table(columns, rows, below)


throughput_table = of_result("throughput")(throughput_of)
speedup_table = of_result("throughput")(speedup_of)
shoes_speedup_table = of_result("throughput_shoes_in_box")(speedup_of)
layout_speedup_table = of_result("throughput_match_regions_layout")(speedup_of)


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


def cores_of(result: Result) -> str:
    """What an update costs by cores and environments, and where its time goes."""
    parts = list(result["cores"]["1"][-1]["microseconds"])
    columns = ["cores", "environments", "bare physics (steps/s)", "PPO (steps/s)", "memory (MiB)",
               *(f"{part} (share of time)" for part in parts)]  # fmt: skip
    rows = []
    for cores, batches in result["cores"].items():
        for batch in batches:
            spent = batch["microseconds"]
            shares = [f"{spent[part] / sum(spent.values()):.2f}" for part in parts]
            rates = [f"{batch[name]:,.0f}" for name in ("physics", "ppo_graph")]
            rows.append([cores, str(batch["num_envs"]), *rates, f"{batch['memory_mib']:,.0f}", *shares])
    return table(columns, rows, f"PPO with the learned reward {where(result)}")


def scale_of(result: Result) -> str:
    """Steps per second of PPO on more cores, on paper, and of several policies in one program, measured."""
    paper, members = result["on_paper"], result["members"]
    most = result["cores"]["1"][-1]["num_envs"]
    first = f"cores, on paper, with {most} environments"
    cores = table([first, *paper], [["PPO (steps/s)", *(f"{rate:,.0f}" for rate in paper.values())]])
    label = f"policies in one program, {result['members_num_envs']} environments each"
    rates = [["PPO, all together (steps/s)", *(f"{rate:,.0f}" for rate in members.values())]]
    return f"{cores}\n\n{table([label, *members], rates)}"


cores_table = of_result("cores")(cores_of)
scale_table = of_result("cores")(scale_of)
