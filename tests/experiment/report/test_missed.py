"""What a run missed, in sentences, from made-up facts."""

from dataclasses import replace

import numpy as np
import pytest

from graphrl_jax.experiment.report.facts import Facts
from graphrl_jax.experiment.report.missed import missed
from graphrl_jax.experiment.run_directory import Run
from graphrl_jax.experiment.settings import compose
from graphrl_jax.registry import make_task
from graphrl_jax.viz.run_page import HeldOut

pytestmark = pytest.mark.usefixtures("outside_package")
RIGHT = np.array([True, True, False])
CURVES = HeldOut(3 * [np.array([0.0, 1.0])], RIGHT, RIGHT, ["success", "success", "dropped"], 8.0, 0.9)


@pytest.fixture
def perfect(tmp_path) -> Facts:
    """A run that missed nothing."""
    run = Run(tmp_path)
    for name in ("rollout.mp4", "policy.npz", "figures/landscape.png"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    return Facts(
        run=run,
        command="train",
        commit="abc",
        settings=compose(make_task("carry"), preset="smoke"),
        summary={"success_rate": 1.0, "episodes": 16},
        encoder={"maxima_inside": 1.0},
        ppo=[{"update": 4, "success": 1.0, "learned_reward": -0.1, "skipped_steps": 0.0, "bad_envs": 0.0}],
        pretrain=[{"step": 40, "skipped_steps": 0.0}],
        subtasks={"subtasks": []},
        held_out=CURVES,
        no_held_out="",
    )


def test_nothing_is_missed_where_everything_is_there(perfect):
    assert missed(perfect) == []


def scores(**below: float) -> dict:
    by_kind = {name: {"undiscounted": -9.0, "end": -0.5} for name in ("success", *below)}
    return {"by_kind": by_kind, "successes_above": {"by_kind": below}}


ROSE = [{"update": n, "success": 0.01, "learned_reward": -1 + 0.1 * n} for n in range(5)]


@pytest.mark.parametrize(
    "changes, sentence",
    [
        ({"summary": {"success_rate": 0.75, "episodes": 16}}, "The policy fails in 4 of 16 unseen episodes."),
        ({"summary": {}}, "The policy was not evaluated, so its success rate is unknown."),
        (
            {"summary": {}, "ppo": [{"update": 2}]},
            "The policy is not trained to its end: 2 of 4 updates.",
        ),
        ({"encoder": {}, "pretrain": []}, "The reward is not learned: pretraining has logged 0 of 40 steps."),
        ({"encoder": {}}, "The audit of the reward is not finished."),
        (
            {"summary": {"success_rate": 0.0, "episodes": 16}, "ppo": ROSE},
            "The learned reward rises from -1.00 to -0.60, but the success rate is 0 %: the policy seems to exploit "
            "the reward.",
        ),
        (
            {"pretrain": [{"step": 20, "skipped_steps": 0.0}, {"step": 40, "skipped_steps": 0.5}]},
            "In pretraining, 25 % of the gradient steps were skipped as not finite.",
        ),
        (
            {"ppo": [{"update": 4, "bad_envs": 0.01}]},
            "In 1 % of the environment steps the physics diverged, and the episode was cut off.",
        ),
        (
            {"ppo": [{"update": 4, "success": np.nan, "kl": np.nan}]},
            "Values that are not finite were logged of kl.",
        ),
        (
            {"encoder": {"maxima_inside": 0.25}},
            "Only 25 % of the landscapes have their largest reward inside the goal.",
        ),
        (
            {"encoder": {"trajectory_scores": scores(dropped=0.9375, held=0.5, left=1.0)}},
            "Some failures often have as much reward as successes do. Share of the pairs in which the success has "
            "more: held (50 %) and dropped (93.8 %).",
        ),
        (
            {"held_out": replace(CURVES, like_success=np.array([True, False, False]))},
            "Held-out successes that do not look like successes: 1 of 2.",
        ),
        (
            {"held_out": replace(CURVES, like_success=np.array([True, True, True]))},
            "Held-out failures that look like successes: 1 of 1 (dropped).",
        ),
        (
            {"held_out": None, "no_held_out": "demos.npz: there is no such file"},
            "The curves of held-out demonstrations are missing (demos.npz: there is no such file).",
        ),
        ({"subtasks": {}}, "The subtasks of held-out demonstrations are missing; graphrl stages finds them."),
        ({"commit": None}, "The commit of the code is unknown, because the code was not in a repository."),
        ({"commit": "abc-dirty"}, "The code had changes that are in no commit, so the run cannot be repeated exactly."),
    ],
)
def test_each_thing_is_one_sentence(perfect, changes, sentence):
    found = missed(replace(perfect, **changes))
    assert sentence in found
    # A run that was not evaluated, or not trained to its end, lacks both.
    assert len(found) <= 2


@pytest.mark.parametrize(
    "file, sentence",
    [
        ("rollout.mp4", "There is no video of the policy; graphrl evaluate makes one."),
        ("figures/landscape.png", "The figure of the reward's landscape is missing."),
    ],
)
def test_each_missing_file_is_one_sentence(perfect, file, sentence):
    (perfect.run.path / file).unlink()
    assert missed(perfect) == [sentence]


def test_what_a_run_does_not_do_is_not_missed(perfect):
    settings = compose(make_task("carry"), "env", "smoke")
    assert missed(replace(perfect, settings=settings, encoder={}, held_out=None, subtasks={}, pretrain=[])) == []
    (perfect.run.path / "policy.npz").unlink()
    (perfect.run.path / "rollout.mp4").unlink()
    assert missed(replace(perfect, command="pretrain", ppo=[], summary={})) == []
