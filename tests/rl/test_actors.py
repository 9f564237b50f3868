"""Policies that have learned nothing."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from brax.envs.base import State

from graphrl_jax.registry import make_task
from graphrl_jax.rl.actors import Actor, policy_named
from graphrl_jax.task import Expert, Task


@pytest.fixture(scope="module")
def carry(outside_package) -> Task:
    return make_task("carry")


def starts(task: Task, batch: int) -> State:
    return jax.vmap(task.reset)(jax.random.split(jax.random.key(0), batch))


def actions(actor: Actor, state: State, steps: int) -> np.ndarray:
    """Actions (steps, B, A) in states that stay as they are."""
    memory, found = actor.begin(state, jax.random.key(1)), []
    for key in jax.random.split(jax.random.key(2), steps):
        memory, action = actor.act(memory, state, key)
        found.append(action)
    return np.stack(found)


def test_zero_does_nothing(carry):
    np.testing.assert_array_equal(actions(policy_named("zero", carry), starts(carry, 5), 3), np.zeros((3, 5, 2)))


def test_random_draws_every_action_anew_from_the_whole_range(carry):
    drawn = actions(policy_named("random", carry), starts(carry, 50), 20)
    assert drawn.shape == (20, 50, 2) and len(np.unique(drawn)) > 1950
    assert np.abs(drawn).max() <= 1 and drawn.min() < -0.99 and drawn.max() > 0.99
    np.testing.assert_allclose(drawn.mean(), 0.0, atol=0.05)


def counting(task: Task) -> Expert:
    """An expert that remembers a number of its own, and how often it has acted."""

    def act(plan: Any, state: State, key: jax.Array) -> tuple[Any, jax.Array]:
        number, count = plan
        return (number, count + 1), jnp.stack([number, count, state.obs[0]])

    return Expert(lambda state, key: (jax.random.uniform(key), 0.0), act)


def with_expert(task: Task, expert: Callable[[Task], Expert]) -> Task:
    """The task with another expert."""
    return type("Other", (type(task),), {"expert": expert})()


def test_an_expert_has_a_plan_in_every_environment_and_keeps_it(carry):
    state = starts(carry, 4)
    made = actions(policy_named("expert", with_expert(carry, counting)), state, 3)
    assert len(np.unique(made[0, :, 0])) == 4
    np.testing.assert_array_equal(made[:, :, 0], np.broadcast_to(made[0, :, 0], (3, 4)))
    np.testing.assert_array_equal(made[:, :, 1], np.broadcast_to([[0], [1], [2]], (3, 4)))
    np.testing.assert_array_equal(made[:, :, 2], np.broadcast_to(state.obs[:, 0], (3, 4)))


def test_an_unknown_policy_and_a_missing_expert_are_one_sentence(carry):
    with pytest.raises(ValueError, match="^unknown policy 'best'; known policies: zero, random, expert$"):
        policy_named("best", carry)
    with pytest.raises(ValueError, match="task carry has no expert that acts step by step"):
        policy_named("expert", with_expert(carry, Task.expert))
