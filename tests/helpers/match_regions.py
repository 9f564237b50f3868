"""Match Regions for tests: one task object, so that programs compiled for it serve them all, and arranged worlds."""

import os
from functools import cache
from pathlib import Path

import jax
import mujoco
import numpy as np
from brax.envs.base import State

from tasks.match_regions import layouts
from tasks.match_regions.model import DRIVEN_MASS, FINGER_OPEN, Physics, build_model
from tasks.match_regions.task import MatchRegions

DATA = Path(os.environ.get("GRAPHRL_DATA", Path(__file__).parents[3] / "shared" / "data"))
RECORDED = DATA / "magical_match_regions"
"""MAGICAL's demonstrations and their true states, where somebody has put them."""
TASK = MatchRegions()
DEMO = layouts.demo_world()
# Iterations enough for the solver to converge.
SOLVED = Physics(iterations=20, ls_iterations=20)


@cache
def start() -> State:
    """A start of `TASK`."""
    return jax.jit(TASK.reset)(jax.random.key(0))


def demo_qpos() -> np.ndarray:
    """The Demo layout, fingers open: (20,)."""
    poses = np.concatenate([layouts.ROBOT_START, [FINGER_OPEN, -FINGER_OPEN], layouts.BLOCK_STARTS.ravel()])
    return poses.astype(np.float32)


def placed(qpos: np.ndarray, block: int, x: float, y: float) -> np.ndarray:
    """`qpos` (20,) with a block somewhere else."""
    qpos = qpos.copy()
    qpos[5 + 3 * block : 7 + 3 * block] = x, y
    return qpos


def alone(robot: tuple[float, float, float], block: tuple[float, float] | None = None) -> np.ndarray:
    """The robot at a pose, the star at `block`, and everything else out of the way along the southern wall."""
    qpos = demo_qpos()
    qpos[:3] = robot
    for index, x in enumerate((-0.8, -0.4, 0.0, 0.4, 0.8)):
        qpos = placed(qpos, index, x, -0.85)
    return qpos if block is None else placed(qpos, 0, *block)


def simulate(qpos: np.ndarray, commands: list[tuple[float, float, bool]], physics: Physics = SOLVED) -> np.ndarray:
    """Plays (speed in units/s, turn in rad/s, open) commands, one per control step, in MuJoCo: final qpos (20,)."""
    model = build_model(physics)
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    for speed, turn, is_open in commands:
        opening = FINGER_OPEN if is_open else 0.0
        for _ in range(physics.substeps):
            rates = np.clip((np.array([opening, -opening]) - data.qpos[3:5]) * 10, -1, 1)
            heading = np.array([-np.sin(data.qpos[2]), np.cos(data.qpos[2])])
            # The force that drives it is limited along its direction, and positions lag (see `Physics`).
            change = speed * heading - data.qvel[:2]
            most = physics.drive_force / DRIVEN_MASS * physics.timestep
            drive = data.qvel[:2] + change * min(1.0, most / max(np.linalg.norm(change), 1e-6))
            data.ctrl[:] = [*drive, turn, *rates]
            before = data.qvel.copy()
            mujoco.mj_step(model, data)
            data.qpos[:] -= physics.lag * physics.timestep * (data.qvel - before)
    return data.qpos.copy()
