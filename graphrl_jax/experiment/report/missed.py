"""What a run lacks or got wrong, one plain sentence for each thing. A run that misses nothing has an empty list."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from graphrl_jax.experiment.report.facts import Facts
from graphrl_jax.experiment.report.numbers import kinds
from graphrl_jax.rl.ppo import OUTCOMES
from graphrl_jax.viz.formats import count, decimal, listed, percent

SELDOM_BELOW = 0.95
"""Failures of a kind count as missed if a smaller share of them than this has less reward than successes."""
EXPLOIT_RISE, EXPLOIT_SUCCESS = 0.1, 0.1
"""A policy seems to exploit a reward that rises by a tenth of the way from start to goal while success stays below."""


def missed(facts: Facts) -> list[str]:
    """The sentences about a run, the gravest first."""
    found = [*_stages(facts), *_policy(facts), *_guards(facts)]
    if facts.learns_reward and facts.encoder:
        found += [*_audit(facts), *_held_out(facts)]
    return [*found, *_files(facts)]


def _stages(facts: Facts) -> Iterator[str]:
    """Stages that are not finished."""
    settings, steps = facts.settings, int(max((record.get("step", 0) for record in facts.pretrain), default=0))
    if facts.learns_reward and not facts.encoder:
        wanted = settings.pretrain_config.steps
        yield (
            f"The reward is not learned: pretraining has logged {count(steps)} of {count(wanted)} steps."
            if steps < wanted
            else "The audit of the reward is not finished."
        )
    if not facts.trains_policy:
        return
    if facts.updates < settings.updates and not facts.evaluated:
        yield f"The policy is not trained to its end: {count(facts.updates)} of {count(settings.updates)} updates."
    if not facts.evaluated:
        yield "The policy was not evaluated, so its success rate is unknown."


def _policy(facts: Facts) -> Iterator[str]:
    """Failures of the policy, and a reward that rises without them becoming fewer."""
    rate, episodes = facts.summary.get("success_rate"), facts.summary.get("episodes")
    if rate is not None and episodes and rate < 1:
        yield f"The policy fails in {count(round((1 - rate) * episodes))} of {count(episodes)} unseen episodes."
    rewards, successes = _values(facts.ppo, "learned_reward"), _values(facts.ppo, "success")
    if len(rewards) < 2 or not len(successes):
        return
    tenth = math.ceil(len(rewards) / 10)
    first, last = float(rewards[:tenth].mean()), float(rewards[-tenth:].mean())
    success = float(successes[-tenth:].mean()) if rate is None else rate
    if last - first >= EXPLOIT_RISE and success < EXPLOIT_SUCCESS:
        yield (
            f"The learned reward rises from {decimal(first)} to {decimal(last)}, but the success rate is "
            f"{percent(success)}: the policy seems to exploit the reward."
        )


def _guards(facts: Facts) -> Iterator[str]:
    """What was not finite, or was not logged as finite."""
    of_stages = {"pretraining": facts.pretrain, "the policy's training": facts.ppo}
    for stage, records in of_stages.items():
        skipped = _values(records, "skipped_steps")
        if skipped.any():
            yield f"In {stage}, {percent(float(skipped.mean()))} of the gradient steps were skipped as not finite."
    bad = _values(facts.ppo, "bad_envs")
    if bad.any():
        share = percent(float(bad.mean()))
        yield f"In {share} of the environment steps the physics diverged, and the episode was cut off."
    lost = {name for records in of_stages.values() for one in records for name, value in one.items() if value != value}
    unexplained = sorted(lost - set(OUTCOMES))  # outcomes are not finite where no episode ended
    if unexplained:
        yield f"Values that are not finite were logged of {listed(unexplained)}."


def _audit(facts: Facts) -> Iterator[str]:
    """What the reward orders wrongly."""
    inside = facts.encoder.get("maxima_inside")
    if inside is not None and inside < 1:
        yield f"Only {percent(inside)} of the landscapes have their largest reward inside the goal."
    weak = [one for one in kinds(facts) if one.below is not None and one.below < SELDOM_BELOW]
    if weak:
        named = listed([f"{one.name} ({percent(one.below)})" for one in sorted(weak, key=lambda one: one.below or 0.0)])
        yield (
            f"Some failures often have as much reward as successes do. Share of the pairs in which the success has "
            f"more: {named}."
        )


def _held_out(facts: Facts) -> Iterator[str]:
    """Held-out demonstrations that the reward takes for what they are not."""
    held_out = facts.held_out
    if held_out is None:
        yield f"The curves of held-out demonstrations are missing ({facts.no_held_out})."
        return
    for success in (True, False):
        chosen = held_out.success == success
        wrong = np.flatnonzero(chosen & (held_out.like_success != success))
        if len(wrong) and success:
            yield f"Held-out successes that do not look like successes: {len(wrong)} of {chosen.sum()}."
        elif len(wrong):
            names = listed(sorted({held_out.kinds[number] for number in wrong}))
            yield f"Held-out failures that look like successes: {len(wrong)} of {chosen.sum()} ({names})."


def _files(facts: Facts) -> Iterator[str]:
    """Files that the page would have shown."""
    if (facts.run.path / "policy.npz").exists() and facts.video is None:
        yield "There is no video of the policy; graphrl evaluate makes one."
    if facts.learns_reward and facts.encoder:
        if "landscape" not in facts.figures and "maxima_inside" in facts.encoder:
            yield "The figure of the reward's landscape is missing."
        if not facts.subtasks:
            yield "The subtasks of held-out demonstrations are missing; graphrl stages finds them."
    if facts.commit is None:
        yield "The commit of the code is unknown, because the code was not in a repository."
    elif "-dirty" in facts.commit:
        yield "The code had changes that are in no commit, so the run cannot be repeated exactly."


def _values(records: Sequence[Mapping[str, Any]], name: str) -> np.ndarray:
    """The finite values of the records that have one."""
    values = np.array([record[name] for record in records if name in record], np.float64)
    return values[np.isfinite(values)]
