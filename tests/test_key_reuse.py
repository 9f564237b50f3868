"""No random key is used twice: resets, experts and rearrangements of every registered task, traced but not compiled."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from graphrl_jax.pretrain.augment import Chances, motion, rearrange
from graphrl_jax.registry import make_task, task_names
from tasks.match_regions import expert as match_regions
from tasks.shoes_in_box import expert as shoes_in_box

# Variants of Match Regions share one expert: tracing it for two tasks is enough for every day.
QUICK = ("match_regions", "match_regions_all", "shoes_in_box")
EXPERTS = [
    pytest.param(name, marks=() if name in QUICK else pytest.mark.slow) for name in task_names() if name != "carry"
]


@pytest.fixture(autouse=True)
def key_reuse_is_an_error():
    with jax.debug_key_reuse(True):
        yield


def trace(function, *arguments) -> None:
    jax.eval_shape(jax.jit(function), jax.random.key(0), *arguments)


def test_the_check_can_fail():
    with pytest.raises(jax.errors.KeyReuseError):
        trace(lambda key: jax.random.normal(key) + jax.random.uniform(key))


@pytest.mark.parametrize("name", task_names())
def test_resets(name):
    task = make_task(name)
    trace(task.reset)
    trace(task.training().reset)


@pytest.mark.parametrize("name", EXPERTS)
def test_experts(name):
    expert = shoes_in_box if name == "shoes_in_box" else match_regions
    expert.rollouts.trace(make_task(name), jax.random.key(0), np.zeros(4, np.int32))


@pytest.mark.parametrize("name", task_names())
def test_rearrangements(name):
    objects = make_task(name).objects
    boxes, mask = jnp.full((3, objects.num_slots, 4), 0.5), jnp.ones((3, objects.num_slots), bool)
    still = motion(boxes, mask, 3, 0.02)
    chances = Chances(bumped=0.2, bumped_before=0.5, approach=0.15, in_order=0.5, tau=0.15)
    trace(lambda key: rearrange(key, objects, still, jnp.linspace(0, 1, 5), chances))
