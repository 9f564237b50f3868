"""Tables of Shoes in Box: Table II, discrimination by reward and by kind of failure, subtasks."""

from benchmarks.tables.cells import Result, interval, mean, missing, of_result, spread, table, where
from graphrl_jax.experiment.methods import METHODS

LEFT_OUT = {
    "activity": "no activity (alpha 1)",
    "reconstruction": "no reconstruction",
    "displacement": "activity by motion between frames",
    "persistence": "activity that does not persist",
    "edges": "no offsets and distances",
}
"""Of our method, in Table II."""
REWARDS = {
    "true_progress": "true progress, from the simulator",
    "graph": METHODS["graph"].label,
    "graph_with_robot": METHODS["graph_with_robot"].label,
    "graph_robot_heard": "graph reward, robot left out of the pooling alone",
}
SUBTASK_METHODS = {"rests": "rests", "change_points": "change points", "uvd": "UVD"}
_MEASURES = (
    ("demonstrations", "rho"), ("whole_episodes", "rho"),
    ("demonstrations", "auroc_per_step"), ("whole_episodes", "auroc"),
    ("demonstrations", "order_success"), ("demonstrations", "order_failure"),
)  # fmt: skip


def table_2_of(result: Result) -> str:
    """How every learned reward tells successes from failures, lowest rho first, and how ours compares."""
    columns = [
        "reward", "rho", "95 % interval", "ours is lower", "AUROC, whole episodes", "95 % interval", "ours is higher",
        "rank correlation with time, successes", "seeds",
    ]  # fmt: skip
    rho, auroc = (result["compared"][name] for name in ("rho, demonstrations", "auroc, whole_episodes"))
    rows = []
    for name in sorted(rho, key=lambda name: rho[name]["mean"]):
        runs = _of(result, name)
        order = spread([run["demonstrations"]["order_success"] for run in runs])
        compared = [cell for measure in (rho, auroc) for cell in _compared(measure[name])]
        rows.append([_label(name), *compared, order, str(len(runs))])
    below = f"Interquartile means over seeds; {missing(result, 'encoders')} {where(result)}"
    return table(columns, rows, below)


def kinds_table_of(result: Result) -> str:
    """Rho of every learned reward by kind of failure: which failures make the order of the table."""
    names = list(result["compared"]["rho, demonstrations"])
    rows = []
    for kind in result["true_progress"]["demonstrations"]["kinds"]:
        found = [mean([run["demonstrations"]["kinds"][kind]["rho"] for run in _of(result, name)]) for name in names]
        rows.append([kind.replace("_", " "), *(f"{value:.3f}" for value in found)])
    return table(["rho, by kind of failure", *map(_label, names)], rows)


def _of(result: Result, name: str) -> list[Result]:
    return [run for run in result["rewards"] if run["reward"] == name]


def _label(name: str) -> str:
    method, _, part = name.partition("_no_")
    return METHODS[method].label + (f", {LEFT_OUT[part]}" if part else "")


def _compared(found: Result) -> list[str]:
    """Interquartile mean, its interval, and the probability that an encoder of ours is better, with its interval."""
    better = found["improvement"]
    shown = f"{better['probability']:.2f} ({interval(better, '{:.2f}')})" if better else "-"
    return [f"{found['mean']:.3f}", interval(found, "{:.3f}"), shown]


def alphas_table_of(result: Result) -> str:
    """How ours tells successes from failures against alpha and temperature, on the episodes of tuning."""
    columns = [
        "temperature", "alpha", "rho", "AUROC of mean rewards", "AUROC, whole episodes",
        "AUROC, whole episodes, discounted as by PPO", "seeds",
    ]  # fmt: skip
    groups: dict[tuple[float, float], list[Result]] = {}
    for member in result["members"]:
        groups.setdefault((member["temperature"], member["swept"]["pretrain.alpha"]), []).append(member["encoder"])
    rows = []
    for (temperature, alpha), audits in groups.items():
        cuts = [audit["discrimination"] for audit in audits]
        whole = [audit["trajectory_scores"]["successes_above"] for audit in audits]
        cells = [spread([cut[name] for cut in cuts]) for name in ("rho", "auroc_per_step")]
        cells += [spread([one[name] for one in whole]) for name in ("undiscounted", "discounted")]
        rows.append([f"{temperature:g}", f"{alpha:g}", *cells, str(len(audits))])
    return table(columns, rows, where(result))


table_2 = of_result("table2")(table_2_of)
alpha_default_table = of_result("alphas_shoes_in_box")(alphas_table_of)
kinds_table = of_result("table2")(kinds_table_of)


@of_result("shoes_in_box")
def discrimination_table(result: Result) -> str:
    """Rho and its companions, on demonstrations and on whole episodes, means over seeds."""
    return _discrimination(result, REWARDS)


def _discrimination(result: Result, labels: dict[str, str]) -> str:
    """A row per reward; one that no seed changes lies in the result itself."""
    columns = [
        "reward", "rho", "rho, whole episodes", "AUROC", "AUROC, whole episodes",
        "rank correlation with time, successes", "rank correlation with time, failures", "seeds",
    ]  # fmt: skip
    rows = []
    for name, label in labels.items():
        seeds = [run for run in result["rewards"] if run["reward"] == name]
        cells = [spread([run[cut][measure] for run in seeds or [result[name]]]) for cut, measure in _MEASURES]
        rows.append([label, *cells, str(len(seeds) or "-")])
    return table(columns, rows, where(result))


@of_result("shoes_in_box")
def failures_table(result: Result) -> str:
    """The same for each kind of failure, for the graph reward w/o robot."""
    columns = [
        "kind of failure", "rho", "rho, whole episodes", "rho of the true progress, whole episodes",
        "AUROC, whole episodes",
    ]  # fmt: skip
    runs = [run for run in result["rewards"] if run["reward"] == "graph"]
    rows = []
    for kind, truth in result["true_progress"]["whole_episodes"]["kinds"].items():
        cuts = {cut: [run[cut]["kinds"][kind] for run in runs] for cut in ("demonstrations", "whole_episodes")}
        rho = [spread([one["rho"] for one in found]) for found in cuts.values()]
        auroc = spread([one["auroc"] for one in cuts["whole_episodes"]])
        rows.append([kind.replace("_", " "), *rho, f"{truth['rho']:.3f}", auroc])
    return table(columns, rows)


@of_result("shoes_in_box")
def subtasks_table(result: Result) -> str:
    """How well subtasks are found, by reward and method; F1 on failures too."""
    columns = [
        "encoder", "method", "F1 at 1 %", "F1 at 2 %", "F1 at 5 %", "covering", "found, of 3", "F1 at 5 %, failures",
    ]  # fmt: skip
    measures = ("f1_at_1%", "f1_at_2%", "f1_at_5%", "covering", "found")
    rows = []
    for name, label in REWARDS.items():
        for method, shown in SUBTASK_METHODS.items():
            found = [run["stages"][method] for run in result["rewards"] if run["reward"] == name]
            if found:
                cells = [spread([one["success"][measure] for one in found]) for measure in measures]
                failed = spread([mean([v["f1_at_5%"] for k, v in one.items() if k != "success"]) for one in found])
                rows.append([label, shown, *cells, failed])
    return table(columns, rows)
