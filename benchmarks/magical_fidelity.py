"""Our Match Regions beside MAGICAL's: what recorded human actions do here, and what they did there.

    python -m benchmarks.magical_fidelity FOLDER

FOLDER holds `truth.npz`. Contacts are chaotic, so there are three questions: does the robot move alike until it touches
something; from a recorded state, do the next ten steps end alike; and how often does a whole replay, its start nudged,
still solve the task. Asked of the task's physics and of a slower one that is nearer (`model.FAITHFUL`). Writes
benchmarks/results/magical_fidelity.json.
"""

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import tyro

from benchmarks.context import RESULTS, measured_on
from benchmarks.timing import seconds_of
from graphrl_jax.runtime import configure, jit_physics
from graphrl_jax.storage import write_json
from tasks.match_regions.layouts import blocks, demo_world
from tasks.match_regions.model import CONTROL_DT, FAITHFUL, Physics
from tasks.match_regions.state import PhysicsState, score
from tasks.match_regions.task import MatchRegions

VARIANTS = {"default": Physics(), "faithful": FAITHFUL}
AHEAD = 10
NUDGES, NUDGE = 16, 1e-6
# As measured with MAGICAL's own physics by those who collected the demonstrations.
_MAGICAL_ITSELF = {"solved": 0.27, "nudge": 1e-9}
# A block has been touched once it is this far from where it lay, and moves if it goes this far in `AHEAD` steps.
_TOUCHED, _MOVES = 2e-3, 0.02


@dataclass(frozen=True)
class Options:
    """Replays recorded human actions in our task.

    Attributes:
      folder: of `truth.npz`.
    """

    folder: tyro.conf.Positional[Path]


def recorded_qpos(states: np.ndarray, fingers: np.ndarray) -> np.ndarray:
    """Our `qpos` (..., 20) of MAGICAL's states (..., 24) and finger angles (..., 2)."""
    return np.concatenate([states[..., :3], fingers, states[..., 9:]], axis=-1).astype(np.float32)


@partial(jit_physics, static_argnums=0)
def replay(task: MatchRegions, qpos: jax.Array, qvel: jax.Array, actions: jax.Array) -> jax.Array:
    """States (B, T + 1, 20) under MAGICAL's actions (B, T), from qpos (B, 20) and qvel (B, 20)."""

    def one(qpos: jax.Array, qvel: jax.Array, actions: jax.Array) -> jax.Array:
        start = PhysicsState(qpos, qvel, jnp.zeros_like(qvel), jnp.ones(2), demo_world())

        def step(state: PhysicsState, number: jax.Array) -> tuple[PhysicsState, jax.Array]:
            state = task.advance(state, number)
            return state, state.qpos

        return jnp.concatenate([qpos[None], jax.lax.scan(step, start, actions)[1]])

    return jax.vmap(one)(qpos, qvel, actions)


def free_motion(task: MatchRegions, qpos: np.ndarray, actions: np.ndarray) -> dict[str, float]:
    """Errors of the robot's path, from the start to the frame before it first touches a block, here or there."""
    ours = np.asarray(replay(task, qpos[:, 0], np.zeros_like(qpos[:, 0]), actions))
    moved = [np.abs(path[:, :, 5:] - path[:, :1, 5:]).max(-1) > _TOUCHED for path in (qpos, ours)]
    touched = np.argmax(moved[0], axis=1), np.argmax(moved[1], axis=1)
    free = np.arange(qpos.shape[1]) < np.minimum(*touched)[:, None] - 1
    position = np.linalg.norm(ours[..., :2] - qpos[..., :2], axis=-1)[free]
    heading = np.abs(_wrapped(ours[..., 2] - qpos[..., 2]))[free]
    fingers = np.abs(ours[..., 3:5] - qpos[..., 3:5]).max(-1)[free]
    return {
        "frames": int(free.sum()),
        "touched_earlier_here": int(np.sum(touched[1] < touched[0])),
        "position_median": float(np.median(position)),
        "position_max": float(position.max()),
        "heading_median": float(np.median(heading)),
        "heading_max": float(heading.max()),
        "finger_max": float(fingers.max()),
    }


def predictions(task: MatchRegions, qpos: np.ndarray, actions: np.ndarray) -> dict[str, Any]:
    """From every recorded state with its velocities (differences of frames): errors one and ten steps later.

    Of the block that moved furthest in those steps, where one did; by how it was moved, and of the robot.
    """
    starts = np.arange(1, qpos.shape[1] - AHEAD)
    begin = qpos[:, starts].reshape(-1, 20)
    speed = ((qpos[:, starts] - qpos[:, starts - 1]) / CONTROL_DT).reshape(-1, 20)
    speed[:, 2] = _wrapped(speed[:, 2] * CONTROL_DT) / CONTROL_DT
    told = np.stack([actions[:, s : s + AHEAD] for s in starts], axis=1).reshape(-1, AHEAD)
    ours = np.asarray(replay(task, begin, speed, told))
    report: dict[str, Any] = {}
    for ahead in (1, AHEAD):
        true = qpos[:, starts + ahead].reshape(-1, 20)
        here, there, then = (_places(values) for values in (begin, true, ours[:, ahead]))
        way = np.linalg.norm(there - here, axis=-1)
        block = way.argmax(1)
        rows = np.arange(len(way))
        moves = way[rows, block] > _MOVES * ahead / AHEAD
        error = np.linalg.norm(then - there, axis=-1)[rows, block]
        closed, backwards = told[:, 0] >= 9, told[:, 0] % 3 == 2
        robot = np.linalg.norm(ours[:, ahead, :2] - true[:, :2], axis=-1)
        kinds = {"all": moves, "carried": closed & ~backwards, "dragged": closed & backwards, "open": ~closed}
        report[f"{ahead}_steps"] = {
            **{name: _summary(error[moves & kind]) for name, kind in kinds.items()},
            "way_median": float(np.median(way[rows, block][moves])),
            "robot": _summary(robot),
        }
    return report


def replays(task: MatchRegions, qpos: np.ndarray, actions: np.ndarray) -> dict[str, float]:
    """Share of whole replays that solve the task, their starts nudged."""
    nudge = np.random.default_rng(0).normal(0, NUDGE, (NUDGES, *qpos[:, 0].shape)).astype(np.float32)
    starts = (qpos[:, 0] + nudge).reshape(-1, 20)
    ours = np.asarray(replay(task, starts, np.zeros_like(starts), np.tile(actions, (NUDGES, 1))))
    scores = np.asarray(jax.vmap(score, (0, None))(ours[:, -1], demo_world())).reshape(NUDGES, -1)
    return {
        "solved": float((scores == 1.0).mean()),
        "mean_score": float(scores.mean()),
        "starts": scores.size,
        "nudge": NUDGE,
        "magical_itself": _MAGICAL_ITSELF,
    }


def _places(qpos: np.ndarray) -> np.ndarray:
    return np.asarray(jax.vmap(blocks)(qpos))[..., :2]


def _wrapped(angle: np.ndarray) -> np.ndarray:
    return (angle + np.pi) % (2 * np.pi) - np.pi


def _summary(values: np.ndarray) -> dict[str, float]:
    return {"number": len(values), **{f"p{q}": float(np.percentile(values, q)) for q in (50, 75, 90) if len(values)}}


def measure(physics: Physics, folder: Path) -> dict[str, Any]:
    """All three comparisons under some physics, and the seconds that replays take once they are compiled."""
    task = MatchRegions(physics=physics, control="discrete")
    with np.load(folder / "truth.npz") as truth:
        qpos, actions = recorded_qpos(truth["states"], truth["rel_finger_angles"]), truth["actions"].astype(np.int32)
    return {
        "free_motion": free_motion(task, qpos, actions),
        "predictions": predictions(task, qpos, actions),
        "replays": replays(task, qpos, actions),
        "replay_s": seconds_of(lambda: replays(task, qpos, actions)),
        "physics": vars(physics),
    }


def main() -> None:
    """Measures, prints and writes."""
    options = tyro.cli(Options, description=__doc__)
    configure()
    report = {name: measure(physics, options.folder) for name, physics in VARIANTS.items()}
    write_json(RESULTS / "magical_fidelity.json", {"variants": report, **measured_on("magical_fidelity")})
    for name, found in report.items():
        print(name, found["free_motion"], found["predictions"]["10_steps"], found["replays"], found["replay_s"])


if __name__ == "__main__":
    main()
