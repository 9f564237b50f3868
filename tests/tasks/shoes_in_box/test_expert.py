"""The scripted expert, and what is read off the states that it reaches."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tasks.shoes_in_box import expert, state
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
    assert np.all(busy > TASK.episode_length / 2)


def test_plans_of_failures_differ_in_what_goes_wrong_and_whether_it_is_tried_again():
    draw = jax.vmap(expert.draw_plan, in_axes=(0, None))
    for kind, name in enumerate(("success", *expert.FAILURES)):
        plans = draw(jax.random.split(jax.random.key(kind), 200), jnp.int32(kind))
        found = {tuple(wrong) for wrong in np.asarray(plans.wrong).tolist()}
        lid, first, second, both = (True, False, False), (False, True, False), (False, False, True), (False, True, True)
        shoes = {first, second} if name == "one_shoe" else {first, second, both}
        assert found == ({(False,) * 3} if name == "success" else {lid} if name.startswith("lid") else shoes), name
        assert (0.3 < np.mean(plans.persists) < 0.7) != (name == "one_shoe"), name


def test_demonstrations_and_failures_have_the_same_lengths(monkeypatch, rollouts):
    states, busy, kinds = rollouts
    plenty = np.resize(np.arange(len(kinds)), 64)
    many = jax.tree.map(lambda leaf: leaf[plenty], states)
    done = busy[plenty] + np.arange(64) % 7

    def solved_before(task, key, wanted):
        order = np.array([np.flatnonzero(kinds[plenty] == kind)[i % 8] for i, kind in enumerate(wanted)])
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
    for kind, name in enumerate(expert.FAILURES, start=1):
        index = int(np.flatnonzero(kinds == kind)[0])
        if name.startswith("lid"):
            assert not opened[index] and not inside[index].any(), name
        else:
            assert opened[index] and not inside[index].all(), name


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
