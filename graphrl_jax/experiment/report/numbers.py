"""The numbers of a run for people: each with its label and what it means."""

from collections.abc import Callable, Mapping
from typing import Any

from graphrl_jax.experiment.report.facts import Facts
from graphrl_jax.reward.statistics import share_interval
from graphrl_jax.viz.formats import count, decimal, duration, percent, short
from graphrl_jax.viz.run_page import Kind, Number

_Row = tuple[str, str, Callable[[Any], str], str]

_AUDIT: tuple[_Row, ...] = (
    ("pair_accuracy", "Random scenes in order", percent,
     "of the pairs of random scenes get the order of their true distance to the goal; 50 % is chance"),
    ("finished_above_unfinished", "Finished first", percent,
     "of the pairs have more reward in the finished scene than in the unfinished one"),
    ("within_above_beside", "Inside above beside", percent,
     "of the scenes have more reward with an object inside the goal than just outside it"),
    ("maxima_inside", "Maxima inside the goal", percent,
     "of the landscapes have their largest reward inside the goal"),
    ("bump_bonus", "Paid for bumping", decimal,
     "reward that a random scene gains if all movable objects count as moved; best near 0"),
    ("value_order_correlation", "Order in time", decimal,
     "rank correlation of the reward with time in held-out successes; best 1"),
    ("kendall_tau", "Kendall's tau", decimal,
     "order in time of the nearest neighbours in another held-out success; best 1"),
    ("cycle_consistency", "Cycle consistency", percent,
     "of the frames come back to themselves by way of two other held-out successes"),
)  # fmt: skip
_DISCRIMINATION: tuple[_Row, ...] = (
    ("final_auroc", "Successes end higher", percent,
     "of the pairs of a held-out success and a failure have more reward at the end of the success"),
    ("auroc", "Successes sum higher", percent,
     "of these pairs have the larger sum of the reward in the success; longer recordings lose more"),
    ("rho", "Rho", decimal, "reward of successes divided by that of failures (Eq. 4); below 1 is good"),
)  # fmt: skip
_SUBTASKS: tuple[_Row, ...] = (
    ("f1_at_5%", "Boundaries within 5 %", percent,
     "F1 of the boundaries against true events, within 5 % of the episode"),
    ("f1_at_2%", "Boundaries within 2 %", percent, "the same within 2 %"),
    ("covering", "Covering", percent, "overlap of the true subtasks with the best found ones"),
    ("found", "Found", decimal, "boundaries per demonstration"),
    ("true", "True", decimal, "events per demonstration"),
)  # fmt: skip


def headline(facts: Facts) -> list[Number]:
    """The first numbers that one wants to see."""
    numbers = _of_policy(facts) if facts.trains_policy else _rows(_AUDIT[:3], facts.encoder)
    return [*numbers, *_of_time(facts)]


def audit_numbers(facts: Facts) -> list[Number]:
    """The numbers of the audit, and of the encoder on held-out demonstrations."""
    return _rows(_AUDIT, facts.encoder) + _rows(_DISCRIMINATION, facts.encoder.get("discrimination") or {})


def subtask_numbers(facts: Facts) -> list[Number]:
    """How the subtasks of subtasks.json were judged, else those of the audit; empty without true events."""
    return _rows(_SUBTASKS, judged(facts))


def judged(facts: Facts) -> Mapping[str, Any]:
    """Measures of the subtasks; see `reward.subtasks.judge`."""
    own = facts.subtasks.get("judged") if facts.subtasks else facts.encoder.get("subtasks")
    return own or {}


def kinds(facts: Facts) -> list[Kind]:
    """Successes and each kind of failure under the learned reward; those that end best come first."""
    scores = facts.encoder.get("trajectory_scores") or {}
    below = (scores.get("successes_above") or {}).get("by_kind") or {}
    found = []
    for name, sums in (scores.get("by_kind") or {}).items():
        end = sums.get("end")
        progress = None if end is None else min(max(1 + end, 0.0), 1.0)
        found.append(Kind(name, progress, sums.get("undiscounted"), below.get(name)))
    return sorted(found, key=lambda kind: -1.0 if kind.end is None else kind.end, reverse=True)


def _of_policy(facts: Facts) -> list[Number]:
    summary, steps = facts.summary, facts.summary.get("env_steps")
    if not steps and facts.ppo:
        steps = facts.ppo[-1].get("env_steps")
    numbers = []
    if facts.evaluated:
        rate, episodes = summary["success_rate"], summary.get("episodes")
        numbers = [
            Number(percent(rate), "Success rate", f"of {count(episodes)} unseen episodes; {_interval(rate, episodes)}"),
            Number(decimal(summary.get("mean_score")), "Mean score", "of these episodes, from 0 to 1"),
        ]
    elif facts.ppo:
        latest = facts.ppo[-1]
        meaning = "of the latest training episodes; the policy was not evaluated"
        numbers = [Number(percent(latest.get("success")), "Success in training", meaning)]
    if steps:
        rate = summary.get("train_steps_per_s")
        done = f"environment steps in {count(facts.updates)} of {count(facts.settings.updates)} updates"
        done += f", {count(rate)} per second" if rate else ""
        numbers.append(Number(short(steps), "Training", done))
    return numbers


def _interval(rate: float | None, episodes: Any) -> str:
    """The interval of a share of episodes, in words."""
    if rate is None or not episodes:
        return "no interval"
    low, high = share_interval(rate, episodes)
    return f"95 % interval {percent(low)} to {percent(high)}"


def _of_time(facts: Facts) -> list[Number]:
    summary = facts.summary
    numbers = []
    if "wall_s" in summary:
        since = "since the run was resumed" if summary.get("resumed") else "for the whole run"
        compiled = f", of which {duration(summary['compile_s'])} to compile" if "compile_s" in summary else ""
        numbers.append(Number(duration(summary["wall_s"]), "Time", f"{since}{compiled}"))
    elif "pretrain_s" in facts.encoder:
        numbers.append(Number(duration(facts.encoder["pretrain_s"]), "Time", "for all steps of pretraining"))
    return numbers


def _rows(rows: tuple[_Row, ...], values: Mapping[str, Any]) -> list[Number]:
    """The rows whose value there is."""
    return [Number(show(values[name]), label, meaning) for name, label, show, meaning in rows if name in values]
