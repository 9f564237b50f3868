"""One control step of Shoes in Box in MJX against C MuJoCo, and the releases that this holds for.

Where a servo's force is at its limit, MJX counts its damping in the implicit integrator all the same, and MuJoCo does
not: the arm then moves differently, as often under random actions. Without limits both agree up to rounding.
"""

import importlib.metadata
import re
import tomllib
from collections.abc import Callable
from functools import cache
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from graphrl_jax.runtime import jit_physics
from tasks.engine import make_engine
from tasks.shoes_in_box import expert
from tasks.shoes_in_box.state import PhysicsState
from tasks.shoes_in_box.task import ShoesInBox

PACKAGES = ("mujoco", "mujoco-mjx")
REPOSITORY = Path(__file__).parents[1]
STATES, EPISODES = 64, 8


def test_both_engines_are_of_one_release():
    """A minor release may change the physics, and MJX follows MuJoCo's numbers."""
    listed = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())["project"]["dependencies"]
    allowed = {name: next(line for line in listed if re.match(rf"{name}\b(?!-)", line)) for name in PACKAGES}
    ranges = {re.fullmatch(rf"{name}>=(\d+)\.(\d+),<(\d+)\.(\d+)", line).groups() for name, line in allowed.items()}
    ((major, minor, next_major, next_minor),) = ranges
    assert (next_major, int(next_minor)) == (major, int(minor) + 1)
    installed = {importlib.metadata.version(name) for name in PACKAGES}
    assert len(installed) == 1 and installed.pop().startswith(f"{major}.{minor}.")
    constraints = (REPOSITORY / "constraints.txt").read_text().splitlines()
    pinned = {line.split("==")[1] for line in constraints if line.split("==")[0] in PACKAGES}
    assert len(pinned) == 1 and pinned.pop().startswith(f"{major}.{minor}.")


@pytest.fixture(scope="module")
def states() -> PhysicsState:
    """States along the expert's episodes, from their starts to their ends."""
    task, random = ShoesInBox(engine="mujoco"), np.random.default_rng(0)
    frames, _ = expert.rollouts(task, jax.random.key(0), jnp.zeros(EPISODES, jnp.int32))
    chosen = np.arange(STATES) * 360 // STATES + random.integers(0, 5, STATES)
    episodes = random.permutation(np.arange(STATES) % EPISODES)
    return jax.tree.map(lambda leaf: leaf[episodes, chosen], frames)


@cache
def advance(engine: str, strength: float) -> Callable:
    """One control step of many states, with servos of the arm that are so many times as strong."""
    task = ShoesInBox(engine=engine)
    task.mj_model.actuator_forcerange[:7] *= strength
    task.engine = make_engine(engine, task.mj_model)
    return jit_physics(jax.vmap(task.advance))


@pytest.mark.study
@pytest.mark.parametrize(
    "strength, speed, joints, lid, shoes",
    [
        # Limits of the median and of the largest difference: radians, radians, metres. The largest ones are of what is
        # being let go or torn out of the grip.
        pytest.param(1.0, 0.0, (2e-6, 1e-3), (1e-6, 1e-3), (1e-6, 5e-3), id="at rest"),
        pytest.param(1.0, 1.0, (6e-3, 4e-2), (1e-6, 1e-1), (1e-6, 3e-2), id="at random"),
        pytest.param(1e3, 1.0, (2e-6, 2e-3), (1e-6, 1e-1), (1e-6, 1e-2), id="at random and strong"),
    ],
)
def test_one_control_step_of_both_engines_agrees(states, strength, speed, joints, lid, shoes):
    random = np.random.default_rng(1)
    actions = jnp.asarray(random.uniform(-1, 1, (STATES, 5)) * np.array([*4 * [speed], 1.0]), jnp.float32)
    mine, other = (jax.tree.map(np.asarray, advance(engine, strength)(states, actions)) for engine in ("mjx", "mujoco"))
    differences = np.abs(mine.qpos - other.qpos)
    places = differences[:, 10:].reshape(STATES, 2, 7)[..., :3]
    for name, found, (median, largest) in (
        ("joints", differences[:, :7].max(1), joints),
        ("lid", differences[:, 9], lid),
        ("shoes", np.linalg.norm(places, axis=-1).max(1), shoes),
    ):
        print(f"{name}: median {np.median(found):.1e}, largest {found.max():.1e}")
        assert np.median(found) <= median and found.max() <= largest, name
    assert (mine.touched == other.touched).mean() >= 0.95 and mine.touched.any()
    moved = np.abs(other.qpos - np.asarray(states.qpos))
    assert speed == 0 or np.median(moved[:, :7].max(1)) > 0.02
