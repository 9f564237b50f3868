"""Writes the README's tables from the committed result files: `python -m benchmarks.readme`.

No number in those tables is typed by hand; a test fails if the README and the result files disagree.
"""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from benchmarks.throughput import LABELS

ROOT = Path(__file__).parents[1]
RESULTS = ROOT / "benchmarks" / "results"
BEGIN, END = "<!-- results: written by a script from result files -->\n", "<!-- end of results -->"
METHODS = {
    "env": "environmental reward, with the reach term",
    "graph": "graph reward, w/o robot",
    "graph_plain_distance": "graph reward, w/o robot, not evened (Eq. 3)",
    "graph_with_robot": "graph reward, w/ robot",
    "graphirl": "GraphIRL, w/o robot",
    "graphirl_with_robot": "GraphIRL, w/ robot",
    "xirl": "XIRL (pixels)",
    "human": "graph reward, w/o robot, from 15 human demonstrations (11 to learn from, 4 held out)",
}
FURTHER = ("graph_plain_distance", "human")
"""Methods with a result file of their own; the others are in Table I."""

LEFT_OUT = {
    "activity": "no activity (alpha 1)",
    "reconstruction": "no reconstruction",
    "persistence": "activity that does not persist",
    "edges": "no offsets and distances",
}
AUDIT = {
    "pair_accuracy": "pairs of random scenes in order",
    "finished_above_unfinished": "finished above unfinished",
    "maxima_inside": "maxima inside the region",
    "within_above_beside": "within the region above just beside it",
    "bump_bonus": "pay for bumping distractors",
    "value_order_correlation": "rank correlation with time",
    "undiscounted": "successes above failures",
    "discounted": "the same, discounted",
}


def table_1() -> str:
    """Every method's policies, best first, and how its reward fares on unseen landscapes and trajectories."""
    result = _result("table1")
    if result is None:
        return ""
    rows = [
        "| reward | success | 95 % interval over seeds | seeds | half of the training episodes solved after (M steps) "
        "| minutes of pretraining and PPO | pairs of random scenes in order | finished above unfinished "
        "| rank correlation with time |",
        "|---" * 9 + "|",
    ]
    methods = sorted(result["methods"].items(), key=lambda item: -item[1]["success_rate"])
    for name, found in methods:
        runs, spread = found["runs"], found["success_interval_95"]
        shown = f"{spread[0]:.1%} to {spread[1]:.1%}" if spread else "one seed"
        half = [run["half_solved_at"] for run in runs]
        reached = [steps / 1e6 for steps in half if steps is not None]
        soon = f"{_spread(reached)}{_of_all(reached, half)}" if reached else "never"
        minutes = _mean([(run["curve"]["seconds"][-1] + run.get("pretrain_s", 0.0)) / 60 for run in runs])
        cells = ["-"] * 3
        if "audit" in runs[0]:
            measures = ("pair_accuracy", "finished_above_unfinished", "value_order_correlation")
            cells = [f"{_mean([run['audit'][measure] for run in runs]):.3f}" for measure in measures]
        rows.append(
            f"| {METHODS[name]} | **{found['success_rate']:.1%}** | {shown} | {len(runs)} | {soon} | {minutes:.0f} "
            f"| {' | '.join(cells)} |"
        )
    return "\n".join([*rows, "", f"{result['episodes']} episodes each {_where(result)}"])


def table_2() -> str:
    """How every learned reward tells successes from failures on Shoes in Box, lowest rho first."""
    result = _result("table2")
    if result is None:
        return ""
    by_reward = {
        name: [run for run in result["rewards"] if run["reward"] == name]
        for name in dict.fromkeys(run["reward"] for run in result["rewards"])
    }
    rho = {name: _mean([run["demonstrations"]["rho"] for run in runs]) for name, runs in by_reward.items()}
    labels = METHODS | {f"graph_no_{part}": f"{METHODS['graph']}, {left_out}" for part, left_out in LEFT_OUT.items()}
    return _discrimination(result, sorted(by_reward, key=lambda name: rho[name]), labels)


def success_table() -> str:
    """Success of policies that are not in Table I."""
    rows = [
        "| reward | success | 95 % interval over seeds | mean score | seeds | environment steps | minutes per run "
        "| commit |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for name in FURTHER:
        result, label = _result(f"match_regions_{name}"), METHODS[name]
        if result is None:
            continue
        runs = result["runs"]
        spread = result["success_interval_95"]
        shown = f"{spread[0]:.1%} to {spread[1]:.1%}" if spread else "one seed"
        minutes = sorted(run["wall_s"] / 60 for run in runs)
        rows.append(
            f"| {label} | **{result['success_rate']:.1%}** | {shown} | {result['mean_score']:.3f} | {len(runs)} "
            f"| {runs[0]['env_steps'] / 1e6:.1f} M | {minutes[0]:.0f} to {minutes[-1]:.0f} "
            f"| {_commit(result)} |"
        )
    return "\n".join(rows)


def audit_table() -> str:
    """How the learned rewards fare on landscapes and trajectories that no training saw, means over seeds."""
    rows = [f"| reward | {' | '.join(AUDIT.values())} |", "|---" * (len(AUDIT) + 1) + "|"]
    for name in FURTHER:
        result, label = _result(f"match_regions_{name}"), METHODS[name]
        if result is None or "audit" not in result["runs"][0]:
            continue
        audits = [run["audit"] | run["audit"]["successes_above"] for run in result["runs"]]
        means = [sum(audit[measure] for audit in audits) / len(audits) for measure in AUDIT]
        rows.append(f"| {label} | {' | '.join(f'{mean:.3f}' for mean in means)} |")
    return "\n".join(rows)


SHOE_REWARDS = {
    "true_progress": "share of stages truly left",
    "graph": "graph reward, w/o robot",
    "graph_with_robot": "graph reward, w/ robot",
    "graph_robot_heard": "graph reward, robot left out of the pooling alone",
}
STAGE_METHODS = {"rests": "rests", "change_points": "change points", "uvd": "UVD"}


def discrimination_table() -> str:
    """Rho and its companions on Shoes in Box, on demonstrations and on whole episodes, means over seeds."""
    result = _result("shoes_in_box")
    return "" if result is None else _discrimination(result, list(SHOE_REWARDS), SHOE_REWARDS)


def _discrimination(result: dict[str, Any], names: list[str], labels: dict[str, str]) -> str:
    """A row per reward; one that no seed changes lies in the result itself."""
    head = "| reward | rho | the same of whole episodes | AUROC | the same of whole episodes"
    rows = [f"{head} | rank correlation with time: successes | failures | seeds |", "|---" * 8 + "|"]
    for name in names:
        runs = [run for run in result["rewards"] if run["reward"] == name] or [result[name]]
        cells = [
            _spread([run[cut][measure] for run in runs])
            for measure, cut in (
                ("rho", "demonstrations"), ("rho", "whole_episodes"), ("auroc_per_step", "demonstrations"),
                ("auroc", "whole_episodes"), ("order_success", "demonstrations"), ("order_failure", "demonstrations"),
            )
        ]  # fmt: skip
        rows.append(f"| {labels[name]} | {' | '.join(cells)} | {len(runs) if name != 'true_progress' else '-'} |")
    return "\n".join([*rows, "", _where(result)])


def failures_table() -> str:
    """The same for each kind of failure, for the graph reward w/o robot."""
    result = _result("shoes_in_box")
    if result is None:
        return ""
    runs = [run for run in result["rewards"] if run["reward"] == "graph"]
    head = "| kind of failure | rho | the same of whole episodes | the same of the stages truly left"
    rows = [f"{head} | AUROC of whole episodes |", "|---" * 5 + "|"]
    for kind, truth in result["true_progress"]["whole_episodes"]["kinds"].items():
        cuts = {cut: [run[cut]["kinds"][kind] for run in runs] for cut in ("demonstrations", "whole_episodes")}
        rho = [_spread([one["rho"] for one in found]) for found in cuts.values()]
        auroc = _spread([one["auroc"] for one in cuts["whole_episodes"]])
        rows.append(f"| {kind.replace('_', ' ')} | {' | '.join(rho)} | {truth['rho']:.3f} | {auroc} |")
    return "\n".join(rows)


def stages_table() -> str:
    """How well stages are found on Shoes in Box, by reward and method; F1 on failures too."""
    result = _result("shoes_in_box")
    if result is None:
        return ""
    head = "| encoder | method | F1 at 1 % | F1 at 2 % | F1 at 5 % | covering | found, of 3"
    rows = [f"{head} | F1 at 5 %, failures |", "|---" * 8 + "|"]
    for name, label in SHOE_REWARDS.items():
        for method, shown in STAGE_METHODS.items():
            found = [run["stages"][method] for run in result["rewards"] if run["reward"] == name]
            if found:
                cells = [
                    _spread([one["success"][measure] for one in found])
                    for measure in ("f1_at_1%", "f1_at_2%", "f1_at_5%", "covering", "found")
                ]
                failed = _spread([_mean([v["f1_at_5%"] for k, v in one.items() if k != "success"]) for one in found])
                rows.append(f"| {label} | {shown} | {' | '.join(cells)} | {failed} |")
    return "\n".join(rows)


def _mean(values: list[float]) -> float:
    return sum(values) / len(values)


def _spread(values: list[float]) -> str:
    """Mean, and least and greatest over seeds where they differ."""
    low, high = f"{min(values):.2f}", f"{max(values):.2f}"
    return f"{_mean(values):.3f}" + (f" ({low} to {high})" if low != high else "")


def _of_all(some: list, everything: list) -> str:
    return "" if len(some) == len(everything) else f", {len(some)} of {len(everything)} seeds"


def _where(result: dict[str, Any]) -> str:
    return f"({result['device']}, commit {_commit(result)}; `{result['command']}`)"


def _commit(result: dict[str, Any]) -> str:
    commit, dirty, _ = result["commit"].partition("-dirty")
    return f"{commit[:7]}{dirty}"


def throughput_table() -> str:
    """Steps per second of training beside bare physics, and the ratios."""
    result = _result("throughput")
    if result is None:
        return ""
    batches = result["batches"]
    rows = [
        f"| control steps/s (of bare physics) with | {' | '.join(str(b['num_envs']) for b in batches)} environments "
        f"| compile (s) | memory (MiB) |",
        "|---" * (len(batches) + 3) + "|",
    ]
    for name, label in LABELS.items():
        cells = [f"{b['steps_per_second'][name]:,.0f} ({b['of_physics'][name]:.2f})" for b in batches]
        largest = batches[-1]
        cells += [f"{largest['compile_s'][name]:.0f}", f"{largest['memory_mib'][name]:,.0f}"]
        rows.append(f"| {label} | {' | '.join(cells)} |")
    return "\n".join(
        [
            *rows,
            "",
            f"Compile time and memory with most environments {_where(result)}",
        ]
    )


def pytorch_table() -> str:
    """Pretraining steps per second beside PyTorch's."""
    result = _result("pytorch")
    if result is None:
        return ""
    names = {
        "jax": "here",
        "pytorch": f"PyTorch {result['torch']}, eager, all pairs in one tensor",
        "pytorch_pair_by_pair": "PyTorch, eager, pair by pair as XIRL's code",
    }
    rows = ["| pretraining, same network, loss and batch | steps/s | time per step, here = 1 |", "|---|---|---|"]
    for name, label in names.items():
        rows.append(f"| {label} | {result['steps_per_second'][name]:.1f} | {result['times_faster'][name]:.1f} |")
    return "\n".join([*rows, "", _where(result)])


def sweeps_table() -> str:
    """Time of a sweep's training beside that of as many separate runs."""
    result = _result("sweeps")
    if result is None:
        return ""
    rows = [
        "| training, compiling included | members | together (s) | one by one (s) | ratio | without compiling "
        "| compiling: together, one by one (s) | largest difference between their curves |",
        "|---" * 8 + "|",
    ]
    labels = [f"encoders, {found['steps']} steps" for found in result["encoders"]] + ["policies, smoke size"]
    for label, found in zip(labels, [*result["encoders"], result["policies"]], strict=True):
        (together, alone), (one, many) = (
            (found[name]["together"], found[name]["alone"]) for name in ("seconds", "compiling")
        )
        rows.append(
            f"| {label} | {found['members']} | {together:.0f} | {alone:.0f} | {together / alone:.2f} "
            f"| {(together - one) / (alone - many):.2f} | {one:.0f}, {many:.0f} | {found['largest_difference']:.1e} |"
        )
    return "\n".join([*rows, "", _where(result)])


def alphas_table() -> str:
    """Success and landscapes against alpha, means over seeds."""
    result = _result("alphas")
    if result is None:
        return ""
    measures = {name: AUDIT[name] for name in ("pair_accuracy", "finished_above_unfinished", "bump_bonus")}
    head = "| alpha | seeds | success | success in training | after (M steps)"
    rows = [f"{head} | {' | '.join(measures.values())} |", "|---" * (len(measures) + 5) + "|"]
    for alpha in dict.fromkeys(member["swept"]["pretrain.alpha"] for member in result["members"]):
        members = [member for member in result["members"] if member["swept"]["pretrain.alpha"] == alpha]
        rates = [member["success_rate"] for member in members if "success_rate" in member]
        trained = [member["training"] for member in members if "training" in member]
        cells = [_spread(rates) if rates else "-"]
        cells += [_spread([one["success"] for one in trained]) if trained else "-"]
        cells += [_spread([one["env_steps"] / 1e6 for one in trained]) if trained else "-"]
        cells += [_spread([member["encoder"][name] for member in members]) for name in measures]
        rows.append(f"| {alpha:g} | {len(members)} | {' | '.join(cells)} |")
    return "\n".join([*rows, "", f"Policies of {result['sweep']['updates']} updates {_where(result)}"])


def human_table() -> str:
    """How well recorded human demonstrations are seen, and what policies trained on them reach."""
    result = _result("human_video")
    if result is None:
        return ""
    overlaps = {
        "detector's boxes, overlap with the true ones": result["iou"],
        "our task's boxes of the same states": result["iou_of_our_tasks_boxes"],
    }
    names, speed = [name.replace("_", " ") for name in result["iou"]], result["frames_per_second"]
    rows = [f"| | {' | '.join(names)} |", "|---" * (len(names) + 1) + "|"]
    rows += [f"| {label} | {' | '.join(f'{value:.3f}' for value in row.values())} |" for label, row in overlaps.items()]
    summary = (
        f"{result['demonstrations']} demonstrations, {result['frames']} frames: {result['found']:.1%} of the objects "
        f"found, {result['identity_switches']} identity switches; with tracking {speed['one_core']:.0f} frames/s on "
        f"one core, {speed['all_cores']:.0f} on all {_where(result)}"
    )
    return "\n".join([*rows, "", summary])


FIDELITY_ROWS = (
    ("share of whole replays that solve the task", "replays", "solved"),
    ("free motion, position: median", "free_motion", "position_median"),
    ("free motion, position: greatest", "free_motion", "position_max"),
    ("free motion, heading (rad): median", "free_motion", "heading_median"),
    ("free motion, heading (rad): greatest", "free_motion", "heading_max"),
)
FIDELITY_KINDS = ("carried", "dragged", "open", "all")


def fidelity_table() -> str:
    """MAGICAL's actions in our task, beside what they did there."""
    result = _result("magical_fidelity")
    if result is None:
        return ""
    variants = result["variants"]
    rows = [f"| recorded actions in our task: error | {' | '.join(variants)} |", "|---" * (len(variants) + 1) + "|"]
    for label, section, measure in FIDELITY_ROWS:
        rows.append(f"| {label} | {' | '.join(f'{v[section][measure]:.3f}' for v in variants.values())} |")
    for kind in FIDELITY_KINDS:
        errors = [variant["predictions"]["10_steps"][kind] for variant in variants.values()]
        shown = " | ".join(f"{error['p50']:.3f} ({error['p90']:.3f})" for error in errors)
        rows.append(f"| ten steps on, block {kind}: median (90 %) | {shown} |")
    seconds = [f"{variant['replay_s']:.1f}" for variant in variants.values()]
    rows.append(f"| seconds for the replays | {' | '.join(seconds)} |")
    replays = variants["default"]["replays"]
    summary = (
        f"Share of {replays['starts']} replays, their starts nudged by {replays['nudge']:g}, that solve the task; "
        f"MAGICAL's own, nudged by {replays['magical_itself']['nudge']:g}: {replays['magical_itself']['solved']:.2f} "
        f"{_where(result)}"
    )
    return "\n".join([*rows, "", summary])


def variants_table() -> str:
    """Success of policies on every variant, by the variant and reward that they were trained on."""
    result = _result("match_regions_variants")
    if result is None:
        return ""
    names = list(result["policies"][0]["success"])
    head = " | ".join(name.replace("_", " ") for name in names)
    rows = [f"| trained on | reward | seeds | {head} |", "|---" * (len(names) + 3) + "|"]
    kinds = dict.fromkeys((policy["trained_on"], policy["reward"]) for policy in result["policies"])
    for trained_on, reward in kinds:
        runs = [p["success"] for p in result["policies"] if (p["trained_on"], p["reward"]) == (trained_on, reward)]
        cells = " | ".join(f"{_mean([run[name] for run in runs]):.1%}" for name in names)
        rows.append(f"| {trained_on.removeprefix('match_regions_')} | {METHODS[reward]} | {len(runs)} | {cells} |")
    return "\n".join([*rows, "", f"{result['episodes']} episodes each {_where(result)}"])


BLOCKS: dict[str, tuple[Callable[[], str], ...]] = {
    "Table I": (table_1,),
    "Match Regions": (success_table, audit_table),
    "throughput": (throughput_table, pytorch_table),
    "Table II": (table_2,),
    "variants": (variants_table,),
    "Shoes in Box": (discrimination_table, failures_table, stages_table),
    "human demonstrations": (human_table, fidelity_table),
    "sweeps": (sweeps_table,),
    "alphas": (alphas_table,),
}


def updated(text: str, tables: str, begin: str = BEGIN) -> str:
    """A text with the tables between its two markers written anew.

    Raises:
      ValueError: a marker is missing.
    """
    before, found, rest = text.partition(begin)
    _, end, after = rest.partition(END)
    if not found or not end:
        raise ValueError(f"the text lacks one of the markers {begin.strip()!r} and {END!r}")
    return f"{before}{begin}\n{tables}\n{END}{after}"


def with_tables(text: str) -> str:
    """The README's text with the tables of every block written anew."""
    for name, tables in BLOCKS.items():
        begin = BEGIN.replace("results", f"results of {name}", 1)
        text = updated(text, "\n\n".join(table() for table in tables) + "\n", begin)
    return text


def _result(name: str) -> dict[str, Any] | None:
    path = RESULTS / f"{name}.json"
    return json.loads(path.read_text()) if path.exists() else None


if __name__ == "__main__":
    readme = ROOT / "README.md"
    readme.write_text(with_tables(readme.read_text()))
