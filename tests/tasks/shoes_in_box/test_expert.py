"""The scripted expert, and what is read off the states that it reaches."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from graphrl_jax.experiment.untrained import evaluate_untrained, untrained
from tasks.shoes_in_box import expert, geometry, kinematics, state
from tasks.shoes_in_box.exploits import EXPLOITS
from tasks.shoes_in_box.model import INNER, WALL, WALL_HEIGHT
from tests.helpers.shoes_in_box import TASK

# A program of thousands of steps: what optimising costs, its run saves twice.
WELL_COMPILED = {"xla_backend_optimization_level": 3, "xla_llvm_disable_expensive_passes": False}
Rollouts = tuple[state.PhysicsState, np.ndarray, np.ndarray]


@pytest.fixture(scope="module")
def rollouts() -> Rollouts:
    """Two successes and a failure of every kind."""
    kinds = np.array([0, 0, *range(1, len(expert.FAILURES) + 1)])
    arguments = jax.random.key(3), jnp.asarray(kinds)
    program = expert.rollouts.lower(TASK, *arguments).compile(compiler_options=WELL_COMPILED)
    states, busy = jax.tree.map(np.asarray, program(*arguments))
    return states, busy, kinds


def last(states: state.PhysicsState) -> state.PhysicsState:
    return jax.tree.map(lambda leaf: leaf[:, -1], states)


def test_the_expert_succeeds_and_failures_fail(rollouts):
    states, busy, kinds = rollouts
    assert np.isfinite(states.qpos).all()
    solved = np.asarray(jax.vmap(state.success)(last(states)))
    assert solved[kinds == 0].all() and not solved[kinds > 0].any()
    # Only shoes on the lid need no lid to be opened, and are done sooner.
    without_lid = kinds == 1 + expert.FAILURES.index("shoe_on_lid")
    assert np.all((busy > TASK.episode_length / 2) | without_lid)


NOTHING, LID, FIRST, SECOND = (False,) * 3, (True, False, False), (False, True, False), (False, False, True)
BOTH = (False, True, True)
WRONG = {
    "success": {NOTHING},
    **dict.fromkeys(("lid_missed", "lid_falls_shut", "lid_half_open"), {LID}),
    **dict.fromkeys(("shoe_missed", "shoe_dropped", "shoe_beside"), {FIRST, SECOND, BOTH}),
    "one_shoe": {FIRST, SECOND},
    "shoe_held": {SECOND},
    **dict.fromkeys(("shoes_knocked", "shoe_on_lid", "box_pushed"), {BOTH}),
}
PERSISTENT = ("lid_missed", "lid_falls_shut", "shoe_missed", "shoe_dropped", "shoe_beside")
SWEEPS = ("shoes_knocked", "box_pushed")


def test_plans_of_failures_differ_in_what_goes_wrong_and_whether_it_is_tried_again():
    draw = jax.vmap(expert.draw_plan, in_axes=(0, None))
    ends = np.cumsum([len(expert.LID_PHASES), len(expert.SHOE_PHASES), len(expert.SHOE_PHASES)])
    for kind, name in enumerate(("success", *expert.FAILURES)):
        plans = jax.tree.map(np.asarray, draw(jax.random.split(jax.random.key(kind), 200), jnp.int32(kind)))
        assert {tuple(wrong) for wrong in plans.wrong.tolist()} == WRONG[name], name
        again = (plans.after != ends).any(axis=1).mean()
        assert 0.3 < again < 0.7 if name in PERSISTENT else again == (name in SWEEPS), name
        assert (plans.start == (ends[0] if name in (*SWEEPS, "shoe_on_lid") else 0)).all(), name
        assert name not in SWEEPS or (plans.after == [*ends[:2], ends[0]]).all(), name


def test_demonstrations_and_failures_have_the_same_lengths(monkeypatch, rollouts):
    states, busy, kinds = rollouts
    plenty = np.resize(np.arange(len(kinds)), 64)
    many = jax.tree.map(lambda leaf: leaf[plenty], states)
    done = busy[plenty] + np.arange(64) % 7

    def solved_before(task, key, wanted):
        order = np.array([np.resize(np.flatnonzero(kinds[plenty] == kind), 64)[i] for i, kind in enumerate(wanted)])
        return jax.tree.map(lambda leaf: leaf[order], many), done[order]

    monkeypatch.setattr(expert, "rollouts", solved_before)
    demos = TASK.demonstrate(jax.random.key(0), 30, 30)
    assert demos.success.sum() == 30 and set(demos.kinds[30:]) == set(expert.FAILURES)
    assert set(demos.lengths[30:]) <= set(demos.lengths[:30]) and demos.lengths.min() > TASK.episode_length / 2
    assert abs(demos.lengths[30:].mean() - demos.lengths[:30].mean()) < 10
    assert (demos.events[demos.success] > 0).all()


def test_failures_fail_by_what_they_are_named_for(rollouts):
    states, _, kinds = rollouts
    inside = np.asarray(jax.vmap(state.shoes_inside)(last(states)))
    opened = np.asarray(jax.vmap(state.lid_is_open)(last(states)))
    for kind, name in enumerate(expert.FAILURES[: -len(EXPLOITS)], start=1):
        index = int(np.flatnonzero(kinds == kind)[0])
        if name.startswith("lid"):
            assert not opened[index] and not inside[index].any(), name
        else:
            assert opened[index] and not inside[index].all(), name


def exploit(rollouts: Rollouts, name: str) -> state.PhysicsState:
    states, _, kinds = rollouts
    index = int(np.flatnonzero(kinds == 1 + expert.FAILURES.index(name))[0])
    return jax.tree.map(lambda leaf: leaf[index], states)


def shoes_of(states: state.PhysicsState) -> np.ndarray:
    """Places (T, 2, 3) of the shoes in the box's frame."""
    frame = geometry.box_pose(jnp.asarray(states.box[0]))
    places = states.qpos[:, 10:].reshape(-1, 2, 7)[..., :3]
    return (places - np.asarray(frame.position)) @ np.asarray(frame.rotation)


def test_knocked_shoes_end_nearer_to_the_shut_box_on_the_table(rollouts):
    states = exploit(rollouts, "shoes_knocked")
    places, aside = shoes_of(states), np.abs(shoes_of(states)[..., 1])
    assert np.abs(states.qpos[:, 9]).max() < 0.05 and places[-1, :, 2].max() < 0.04
    # Shoved more than once.
    half = len(places) // 2
    assert (aside[half] < aside[0] - 0.02).all() and (aside[-1] < aside[half] - 0.02).any()
    assert states.touched.any(0).all() and states.qpos[1:, 7:9][100:].max() < 0.005


def test_shoes_are_laid_on_the_shut_lid(rollouts):
    states = exploit(rollouts, "shoe_on_lid")
    places = shoes_of(states)[-1]
    assert np.abs(states.qpos[:, 9]).max() < 0.05 and not states.touched[-1].any()
    assert (np.abs(places[:, :2]) < INNER).all() and (np.abs(places[:, 2] - WALL_HEIGHT) < 0.01).all()


def test_a_shoe_is_held_above_the_open_box_and_never_let_go(rollouts):
    states = exploit(rollouts, "shoe_held")
    places, inside = shoes_of(states), np.asarray(jax.vmap(state.shoes_inside)(states))
    held = int(states.touched[-1].argmax())
    assert states.qpos[-1, 9] > state.LID_COUNTS_AS_OPEN and inside[-1, 1 - held] and not states.touched[-1, 1 - held]
    last = slice(-80, None)
    assert states.touched[last, held].all() and (np.abs(places[last, held, :2]) < INNER).all()
    assert np.all((WALL_HEIGHT < places[last, held, 2]) & (places[last, held, 2] < WALL_HEIGHT + 0.1))


def test_the_lid_is_held_half_open(rollouts):
    angles = exploit(rollouts, "lid_half_open").qpos[:, 9]
    assert angles.max() < 1.2 and np.all((0.85 < angles[-300:]) & (angles[-300:] < 1.15))


def test_the_box_is_pushed_and_nothing_else(rollouts):
    states = exploit(rollouts, "box_pushed")
    places = shoes_of(states)
    assert np.abs(places - places[:1]).max() < 0.005 and np.abs(states.qpos[:, 9]).max() < 0.05
    frame = geometry.box_pose(jnp.asarray(states.box[0]))
    tips = np.asarray(jax.vmap(kinematics.pose)(states.qpos[:, :7]))[:, :3] - np.asarray(frame.position)
    x, y, z = (tips @ np.asarray(frame.rotation)).T
    # The wall stops closed fingers, which reach 16 mm, on either side of the box.
    gap = np.abs(x) - (INNER[0] + 2 * WALL)
    pressing = (gap < 0.017) & (z < WALL_HEIGHT)
    assert pressing.mean() > 0.2 and gap[pressing].min() > 0.011
    assert (x[pressing] < 0).any() and np.ptp(y[pressing & (x > 0)]) > 0.2


def test_a_carried_shoe_is_touched_and_its_events_come_in_order(rollouts):
    states, _, _ = rollouts
    solved = int(np.flatnonzero(np.asarray(jax.vmap(state.success)(last(states))))[0])
    single = jax.tree.map(lambda leaf: leaf[solved], states)
    height = single.qpos[:, [12, 19]]
    lifted = height > 0.12
    assert lifted.any(0).all() and (single.touched[lifted]).mean() > 0.95
    events = np.asarray(jax.vmap(state.events)(single))
    first = events.argmax(0)
    assert events[-1].all() and 0 < first[0] < first[1:].min() and not single.touched[first[1:], [0, 1]].any()
    assert np.asarray(jax.vmap(state.score)(single))[-1] == pytest.approx(1.0)


@pytest.mark.slow
def test_the_expert_as_a_policy_succeeds():
    found = evaluate_untrained(untrained(TASK, "expert"), 4, seed=0)
    assert found["success_rate"] == found["mean_score"] == 1.0
