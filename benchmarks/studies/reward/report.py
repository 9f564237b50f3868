"""Tables and figures of the study, from its three result files into report.md."""

import math
import textwrap
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from scipy.stats import spearmanr

from benchmarks.figures import plain, save
from benchmarks.tables.markers import updated
from graphrl_jax.storage import read_json

MEASURES = {
    "pair_accuracy": "pairs in order",
    "finished_above_unfinished": "finished above",
    "maxima_inside": "maxima inside",
    "within_above_beside": "within above beside",
    "bump_bonus": "pay for bumping",
    "value_order_correlation": "rank correlation with time",
    "undiscounted": "successes above",
    "discounted": "successes above, discounted",
}
SUMS = ("undiscounted", "discounted")
Rows = dict[str, dict[str, Any]]


def write_report(folder: Path, results: Path) -> None:
    """Writes the tables between the markers of report.md, and the figures beside it, of what was measured.

    Args:
      folder: with encoders.json, policies.json and ceilings.json, as far as they exist.
      results: with the result files of whole trainings on the graph reward.
    """
    encoders, policies, ceilings = (
        read_json(path) if path.exists() else {}
        for path in (folder / f"{name}.json" for name in ("encoders", "policies", "ceilings"))
    )
    full = {path.stem.removeprefix("match_regions_"): read_json(path) for path in sorted(results.glob("*_graph*.json"))}
    ranked = {member: row for member, row in policies.items() if row["variant"] == "default"}
    parts = [
        encoder_table(encoders) if encoders else "",
        ceiling_table(ceilings["seeds"]) if ceilings else "",
        oracle_table(encoders, ranked) if ranked else "",
        policy_table(policies) if policies else "",
        full_table(full) if full else "",
    ]
    report = folder / "report.md"
    tables = "\n\n".join(table for table in parts if table)
    report.write_text(updated(report.read_text(), f"{tables}\n"))
    if encoders:
        save(encoder_figure(encoders), folder / "encoders.png")
    if ranked:
        save(oracle_figure(encoders, ranked), folder / "oracle.png")


def measure(row: dict[str, Any], name: str) -> float:
    """One of `MEASURES` of an encoder."""
    return row["successes_above"][name] if name in row["successes_above"] else row[name]


def by_variant(encoders: Rows, name: str) -> dict[str, np.ndarray]:
    """The values of a measure over seeds, for every variant in the order of the table."""
    variants = list(dict.fromkeys(row["variant"] for row in encoders.values()))
    return {
        variant: np.array([measure(row, name) for row in encoders.values() if row["variant"] == variant])
        for variant in variants
    }


def encoder_table(encoders: Rows) -> str:
    """Mean over seeds, and the worst seed, of every measure and variant."""
    measured = {name: by_variant(encoders, name) for name in MEASURES}
    lines = [f"| variant | {' | '.join(MEASURES.values())} | seeds |", "|---" * (len(MEASURES) + 2) + "|"]
    for variant, first in measured["pair_accuracy"].items():
        cells = [f"{values[variant].mean():.3f} ({values[variant].min():.2f})" for values in measured.values()]
        lines.append(f"| {variant} | {' | '.join(cells)} | {len(first)} |")
    return "\n".join(lines)


def ceiling_table(seeds: dict[str, Any]) -> str:
    """What ideal values of the way to go score, mean over seeds, for every weight of the robot's way, and without."""
    measures = [f"{name}_by_approach" for name in ("pair_accuracy", "rank_correlation", "kendall_tau")]
    lines = [
        "| ideal value: way to go, robot's way times | pairs in order | rank correlation with time | Kendall's tau |",
        "|---|---|---|---|",
    ]
    for approach in next(iter(seeds.values()), {measures[0]: ()})[measures[0]]:
        means = [np.mean([row[measure][approach] for row in seeds.values()]) for measure in measures]
        lines.append(f"| {approach} | {' | '.join(f'{mean:.3f}' for mean in means)} |")
    finished = np.mean([row["finished_above_unfinished"]["ends"] for row in seeds.values()])
    above = {name: np.mean([row["successes_above"][name] for row in seeds.values()]) for name in SUMS}
    lines += [
        "",
        f"| robot's way times | finished above | {' | '.join(MEASURES[name] for name in SUMS)} |",
        "|---|---|---|---|",
        f"| 0.0 | {finished:.3f} | {' | '.join(f'{share:.3f}' for share in above.values())} |",
    ]
    return "\n".join(lines)


def oracle_table(encoders: Rows, policies: Rows) -> str:
    """Success of the policies, one per encoder, best first, and how each measure of the encoder ranks with it."""
    lines = ["| encoder | success | mean score | million steps |", "|---|---|---|---|"]
    for member, row in sorted(policies.items(), key=lambda item: -item[1]["success_rate"]):
        steps = row["env_steps"] / 1e6
        lines.append(f"| {member} | {row['success_rate']:.1%} | {row['mean_score']:.3f} | {steps:.1f} |")
    lines += ["", "| measure | rank correlation with the policy's score |", "|---|---|"]
    for name, label in MEASURES.items():
        lines.append(f"| {label} | {_rank_correlation(encoders, policies, name):.2f} |")
    return "\n".join(lines)


def full_table(results: dict[str, dict[str, Any]]) -> str:
    """Whole trainings by the name of their result file: outcome and audit of each run, soonest half solved first.

    The last row ranks each measure with how soon half of the training episodes were solved; never counts as last.
    """
    runs = [(name, run) for name, result in results.items() for run in result["runs"]]
    soonest = sorted(runs, key=lambda item: item[1]["half_solved_at"] or math.inf)
    lines = [
        f"| training | seed | success | half solved at, million steps | {' | '.join(MEASURES.values())} |",
        "|---" * (len(MEASURES) + 4) + "|",
    ]
    for name, run in soonest:
        at = f"{run['half_solved_at'] / 1e6:.1f}" if run["half_solved_at"] else "never"
        cells = [f"{measure(run['audit'], column):.3f}" for column in MEASURES]
        lines.append(f"| {name} | {run['training_seed']} | {run['success_rate']:.1%} | {at} | {' | '.join(cells)} |")
    times = [run["half_solved_at"] or 10 * run["env_steps"] for _, run in runs]
    soon = [-time for time in times]
    ranks = [rank_correlation(soon, [measure(run["audit"], column) for _, run in runs]) for column in MEASURES]
    shown = ["all alike" if math.isnan(rank) else f"{rank:.2f}" for rank in ranks]
    return "\n".join([*lines, f"| rank correlation with being soon | | | | {' | '.join(shown)} |"])


def policy_table(policies: Rows) -> str:
    """Success and score of every way to train policies, on encoders that all of them had; means over seeds."""
    variants = list(dict.fromkeys(row["variant"] for row in policies.values()))
    used = [{row["encoder"] for row in policies.values() if row["variant"] == variant} for variant in variants]
    shared = set.intersection(*used) if used else set()
    lines = ["| policy | success | mean score | seeds |", "|---|---|---|---|"]
    for variant in variants:
        rows = [row for row in policies.values() if row["variant"] == variant and row["encoder"] in shared]
        success, score = (np.mean([row[name] for row in rows]) for name in ("success_rate", "mean_score"))
        lines.append(f"| {variant} | {success:.1%} | {score:.3f} | {len(rows)} |")
    return "\n".join(lines)


def encoder_figure(encoders: Rows) -> Figure:
    """Every measure of every variant, a dot per seed."""
    figure = Figure(figsize=(12, 6), dpi=110, layout="constrained")
    for axes, (name, label) in zip(figure.subplots(1, len(MEASURES), sharey=True), MEASURES.items(), strict=True):
        values = by_variant(encoders, name)
        for row, seeds in enumerate(values.values()):
            axes.plot(seeds, [row] * len(seeds), "o", color="tab:blue", alpha=0.6, markersize=4)
        axes.set_yticks(range(len(values)), list(values))
        axes.set_title(textwrap.fill(label, 16), fontsize=9)
        axes.grid(axis="y", alpha=0.3)
        plain(axes)
    figure.axes[0].invert_yaxis()
    return figure


def oracle_figure(encoders: Rows, policies: Rows) -> Figure:
    """The policy's score against every measure of its encoder."""
    figure = Figure(figsize=(12, 2.8), dpi=110, layout="constrained")
    for axes, (name, label) in zip(figure.subplots(1, len(MEASURES), sharey=True), MEASURES.items(), strict=True):
        for member, row in policies.items():
            axes.plot(measure(encoders[member], name), row["mean_score"], "o", color="tab:green", alpha=0.7)
        axes.set_title(f"{label}\nrank corr. {_rank_correlation(encoders, policies, name):.2f}", fontsize=9)
        plain(axes)
    figure.axes[0].set_ylabel("mean score of the policy")
    return figure


def rank_correlation(one: list[float], other: list[float]) -> float:
    """Spearman's; NaN where one of both never varies."""
    if min(len(set(one)), len(set(other))) < 2:
        return float("nan")
    return float(spearmanr(one, other).statistic)


def _rank_correlation(encoders: Rows, policies: Rows, name: str) -> float:
    scores = [row["mean_score"] for row in policies.values()]
    return rank_correlation([measure(encoders[member], name) for member in policies], scores)
