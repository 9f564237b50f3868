"""Writes the README's tables from the committed result files: `python -m benchmarks.readme`.

No number in those tables is typed by hand; a test fails if the README and the result files disagree.
"""

import json
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
RESULTS = ROOT / "benchmarks" / "results"
BEGIN, END = "<!-- results: written by a script from result files -->\n", "<!-- end of results -->"
METHODS = {
    "env": "environmental reward, with the reach term",
    "graph": "graph reward, w/o robot",
    "graph_plain_distance": "graph reward, w/o robot, not evened (Eq. 3)",
    "graph_with_robot": "graph reward, w/ robot",
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


def success_table() -> str:
    """Success of the policies trained on each reward."""
    rows = [
        "| reward | success | 95 % interval over seeds | mean score | seeds | environment steps | minutes per run |",
        "|---|---|---|---|---|---|---|",
    ]
    for name, label in METHODS.items():
        result = _result(f"match_regions_{name}")
        if result is None:
            continue
        runs = result["runs"]
        spread = result["success_interval_95"]
        shown = f"{spread[0]:.1%} to {spread[1]:.1%}" if spread else "one seed"
        minutes = sorted(run["wall_s"] / 60 for run in runs)
        rows.append(
            f"| {label} | **{result['success_rate']:.1%}** | {shown} | {result['mean_score']:.3f} | {len(runs)} "
            f"| {runs[0]['env_steps'] / 1e6:.1f} M | {minutes[0]:.0f} to {minutes[-1]:.0f} |"
        )
    return "\n".join(rows)


def audit_table() -> str:
    """How the learned rewards fare on landscapes and trajectories that no training saw, means over seeds."""
    rows = [f"| reward | {' | '.join(AUDIT.values())} |", "|---" * (len(AUDIT) + 1) + "|"]
    for name, label in METHODS.items():
        result = _result(f"match_regions_{name}")
        if result is None or "audit" not in result["runs"][0]:
            continue
        audits = [run["audit"] | run["audit"]["successes_above"] for run in result["runs"]]
        means = [sum(audit[measure] for audit in audits) / len(audits) for measure in AUDIT]
        rows.append(f"| {label} | {' | '.join(f'{mean:.3f}' for mean in means)} |")
    return "\n".join(rows)


def throughput_table() -> str:
    """Steps per second of training beside bare physics, and the ratios."""
    result = _result("throughput")
    if result is None:
        return ""
    names = {
        "physics": "bare `mjx.step`, same scene and sub-steps",
        "environment": "environment step",
        "ppo_env": "PPO, environmental reward",
        "ppo_graph": "PPO, learned reward",
    }
    rates = result["steps_per_second"]
    rows = ["| program | control steps/s | of bare physics |", "|---|---|---|"]
    rows += [f"| {names[name]} | {rate:,.0f} | {rate / rates['physics']:.2f} |" for name, rate in rates.items()]
    where = f"{result['num_envs']} environments, {result['device']}, commit {result['commit'][:7]}"
    return "\n".join([*rows, "", f"({where}; `{result['command']}`)"])


def results() -> str:
    """Everything between the README's two markers."""
    return f"{success_table()}\n\n{audit_table()}\n\n{throughput_table()}\n"


def updated(text: str, tables: str) -> str:
    """A text with the tables between its two markers written anew.

    Raises:
      ValueError: a marker is missing.
    """
    before, _, rest = text.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not end:
        raise ValueError(f"the text lacks one of the markers {BEGIN.strip()!r} and {END!r}")
    return f"{before}{BEGIN}\n{tables}\n{END}{after}"


def _result(name: str) -> dict[str, Any] | None:
    path = RESULTS / f"{name}.json"
    return json.loads(path.read_text()) if path.exists() else None


if __name__ == "__main__":
    readme = ROOT / "README.md"
    readme.write_text(updated(readme.read_text(), results()))
