"""Tables of Match Regions: the earlier Table I, further methods, variants, alpha."""

from benchmarks.tables.cells import (
    Result,
    commit,
    mean,
    of_result,
    percent_interval,
    result_of,
    spread,
    spread_of_some,
    table,
    where,
)
from graphrl_jax.experiment.methods import METHODS

FURTHER = {
    "graph_plain_distance": "graph reward, w/o robot, not evened (Eq. 3)",
    "human": "graph reward, w/o robot, from 15 human demonstrations (11 to learn from, 4 held out)",
}
"""What has a result file of its own."""
AUDIT = {
    "pair_accuracy": "pairs of random scenes ordered as by the true distance",
    "finished_above_unfinished": "finished scenes above unfinished ones",
    "maxima_inside": "maxima inside the region",
    "within_above_beside": "target within the region above target just outside",
    "bump_bonus": "reward for bumping distractors",
    "value_order_correlation": "rank correlation with time",
    "undiscounted": "successes above failures, undiscounted",
    "discounted": "successes above failures, discounted",
}


@of_result("table1_earlier")
def headline(result: Result) -> str:
    """Success of every method's policies, best first."""
    rows = [
        [METHODS[name].label, f"**{found['success_rate']:.1%}**", percent_interval(found["success_interval_95"]),
         str(len(found["runs"]))]
        for name, found in _best_first(result)
    ]  # fmt: skip
    return table(["reward", "success", "95 % interval over seeds", "seeds"], rows)


@of_result("table1_earlier")
def earlier_table_1(result: Result) -> str:
    """Every method's policies, best first, and how its reward fares on unseen landscapes and trajectories."""
    measures = ("pair_accuracy", "finished_above_unfinished", "value_order_correlation")
    columns = [
        "reward", "success", "95 % interval over seeds", "seeds",
        "half of the training episodes solved after (M steps)", "minutes of pretraining and PPO",
        *(AUDIT[measure] for measure in measures),
    ]  # fmt: skip
    rows = []
    for name, found in _best_first(result):
        runs = found["runs"]
        half = [run["half_solved_at"] for run in runs]
        soon = spread_of_some([None if steps is None else steps / 1e6 for steps in half])
        minutes = mean([(run["curve"]["seconds"][-1] + run.get("pretrain_s", 0.0)) / 60 for run in runs])
        audits = ["-"] * len(measures)
        if "audit" in runs[0]:
            audits = [f"{mean([run['audit'][measure] for run in runs]):.3f}" for measure in measures]
        interval = percent_interval(found["success_interval_95"])
        success = f"**{found['success_rate']:.1%}**"
        rows.append([METHODS[name].label, success, interval, str(len(runs)), soon, f"{minutes:.0f}", *audits])
    return table(columns, rows, f"{result['episodes']} episodes each {where(result)}")


def _best_first(result: Result) -> list[tuple[str, Result]]:
    return sorted(result["methods"].items(), key=lambda item: -item[1]["success_rate"])


def success_table() -> str:
    """Success of policies that are not in Table I."""
    columns = [
        "reward", "success", "95 % interval over seeds", "mean score", "seeds", "environment steps", "minutes per run",
        "commit",
    ]  # fmt: skip
    rows = []
    for label, result in _further():
        runs = result["runs"]
        minutes = sorted(run["wall_s"] / 60 for run in runs)
        rows.append(
            [label, f"**{result['success_rate']:.1%}**", percent_interval(result["success_interval_95"]),
             f"{result['mean_score']:.3f}", str(len(runs)), f"{runs[0]['env_steps'] / 1e6:.1f} M",
             f"{minutes[0]:.0f} to {minutes[-1]:.0f}", commit(result)]
        )  # fmt: skip
    return table(columns, rows)


def audit_table() -> str:
    """How their learned rewards fare on landscapes and trajectories that no training saw, means over seeds."""
    rows = []
    for label, result in _further():
        if "audit" in result["runs"][0]:
            audits = [run["audit"] | run["audit"]["successes_above"] for run in result["runs"]]
            rows.append([label, *(f"{mean([audit[measure] for audit in audits]):.3f}" for measure in AUDIT)])
    return table(["reward", *AUDIT.values()], rows)


def _further() -> list[tuple[str, Result]]:
    """Labels and result files, those that are there."""
    found = {label: result_of(f"match_regions_{name}") for name, label in FURTHER.items()}
    return [(label, result) for label, result in found.items() if result is not None]


@of_result("match_regions_variants")
def variants_table(result: Result) -> str:
    """Success of policies on every variant, by the variant and reward that they were trained on."""
    names = list(result["policies"][0]["success"])
    rows = []
    for trained_on, reward in dict.fromkeys((policy["trained_on"], policy["reward"]) for policy in result["policies"]):
        runs = [p["success"] for p in result["policies"] if (p["trained_on"], p["reward"]) == (trained_on, reward)]
        cells = [f"{mean([run[name] for run in runs]):.1%}" for name in names]
        rows.append([trained_on.removeprefix("match_regions_"), METHODS[reward].label, str(len(runs)), *cells])
    columns = ["trained on", "reward", "seeds", *(name.replace("_", " ") for name in names)]
    return table(columns, rows, f"{result['episodes']} episodes each {where(result)}")


@of_result("alphas")
def alphas_table(result: Result) -> str:
    """Success and landscapes against alpha, means over seeds."""
    measures = {name: AUDIT[name] for name in ("pair_accuracy", "finished_above_unfinished", "bump_bonus")}
    rows = []
    for alpha in dict.fromkeys(member["swept"]["pretrain.alpha"] for member in result["members"]):
        members = [member for member in result["members"] if member["swept"]["pretrain.alpha"] == alpha]
        trained = [member["training"] for member in members if "training" in member]
        columns = [
            [member["success_rate"] for member in members if "success_rate" in member],
            [one["success"] for one in trained],
            [one["env_steps"] / 1e6 for one in trained],
            *([member["encoder"][name] for member in members] for name in measures),
        ]
        rows.append([f"{alpha:g}", str(len(members)), *(spread(found) if found else "-" for found in columns)])
    columns = ["alpha", "seeds", "success", "success in training", "environment steps (M)", *measures.values()]
    return table(columns, rows, f"Policies of {result['sweep']['updates']} updates {where(result)}")
