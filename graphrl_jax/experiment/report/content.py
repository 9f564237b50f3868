"""The content of a run's page, from the facts of the run."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from graphrl_jax.experiment.report.facts import Facts
from graphrl_jax.experiment.report.missed import missed
from graphrl_jax.experiment.report.numbers import audit_numbers, headline, kinds, subtask_numbers
from graphrl_jax.experiment.settings import as_json
from graphrl_jax.registry import task_names
from graphrl_jax.viz.formats import count
from graphrl_jax.viz.run_page import RunContent, Subtasks

_CAPTIONS = {
    "landscape": "The reward as one object is moved over the arena and all others stay.",
    "reward_on_rollouts": "The reward along episodes of the policy.",
    "reward_on_demonstrations": "The reward along held-out successes, with true events.",
}
_RECORDED = (
    "The task is known from recordings alone. Scenes are rearrangements of held-out demonstrations, and the time that "
    "is left in one stands for the distance to the goal."
)


def content_of(facts: Facts, command: str, command_note: str) -> RunContent:
    """The content of the page.

    Args:
      facts: of the run.
      command: repeats the run.
      command_note: what there is to say about it.
    """
    settings = facts.settings
    return RunContent(
        title=f"{settings.task}: {settings.method.label}",
        about=_about(facts),
        numbers=headline(facts),
        missed=missed(facts),
        ppo=facts.ppo,
        pretrain=facts.pretrain,
        success_rate=facts.summary.get("success_rate"),
        audit=audit_numbers(facts),
        audit_note="" if facts.trains_policy or settings.task in task_names() else _RECORDED,
        kinds=kinds(facts),
        held_out=facts.held_out,
        subtasks=_subtasks(facts),
        subtask_numbers=subtask_numbers(facts),
        landscape=_figure(facts, "landscape"),
        rollouts=_figure(facts, "reward_on_rollouts"),
        demonstrations=None if facts.held_out else _figure(facts, "reward_on_demonstrations"),
        video=facts.video,
        command=command,
        command_note=command_note,
        settings=_groups(facts),
        made_with=_made_with(facts),
    )


def _about(facts: Facts) -> str:
    """What the run is."""
    settings = facts.settings
    learned = ""
    if facts.learns_reward:
        source = "the scripted expert" if settings.demos is None else Path(settings.demos).name
        number = "" if facts.card is None else f"{count(facts.card.demonstrations)} "
        learned = f" A reward learned from {number}demonstrations of {source}" if facts.encoder else ""
        learned += (", and a policy trained on it." if facts.trains_policy else "; no policy.") if learned else ""
    return f"Run {facts.run.path.resolve().name} of graphrl {facts.command}, seed {settings.seed}.{learned}"


def _figure(facts: Facts, name: str) -> tuple[Path, str] | None:
    return (facts.figures[name], _CAPTIONS[name]) if name in facts.figures else None


def _subtasks(facts: Facts) -> Subtasks | None:
    """The subtasks of subtasks.json, if it is known how long the demonstrations are in seconds."""
    rows, card = facts.subtasks.get("subtasks"), facts.card
    if not rows or card is None:
        return None
    of = "held-out successes" if "demos" not in facts.subtasks else f"the demonstrations of {facts.subtasks['demos']}"
    found = [(row["kind"] or "demonstration", row["length"] / card.frame_rate, row["seconds"]) for row in rows]
    return Subtasks(of, facts.subtasks.get("method", ""), found)


def _groups(facts: Facts) -> dict[str, dict[str, str]]:
    """Settings as text by group, without those that change nothing about the run."""
    values = as_json(facts.settings)
    if facts.settings.image_size is None:
        del values["pretrain_config"]["encoder"]["pixels"]
    groups = {"run": {name: _text(value) for name, value in values.items() if not isinstance(value, dict)}}
    learned = ("pretrain", "pretrain_config") if facts.learns_reward else ()
    trained = ("ppo", "ppo_config") if facts.trains_policy else ()
    return groups | {group: _flat(values[group]) for group in (*learned, *trained)}


def _flat(values: Mapping[str, Any], prefix: str = "") -> dict[str, str]:
    """Settings of a group by name; those of a group inside it have names such as encoder.kind."""
    flat = {}
    for name, value in values.items():
        flat |= _flat(value, f"{prefix}{name}.") if isinstance(value, dict) else {f"{prefix}{name}": _text(value)}
    return flat


def _text(value: Any) -> str:
    if isinstance(value, list | tuple):
        return " ".join(map(_text, value))
    return "-" if value is None else f"{value:g}" if isinstance(value, float) else str(value)


def _made_with(facts: Facts) -> dict[str, str]:
    """Device, commit and versions."""
    summary = facts.summary
    device = {"device": str(summary["device"])} if "device" in summary else {}
    return {**device, "commit": facts.commit or "unknown", **dict(summary.get("versions") or {})}
