"""The scripted expert: grips blocks and carries them to the goals of its plan, in one batched program.

A plan is a list of jobs (a block and its goal). Successes and all kinds of deliberate failure differ only in their
jobs. A job has seven phases: approach a point beside the block, face it, advance, grip, carry it to its goal, release
and back off. Ways lead round other blocks. Plans vary in order, speed, pauses, approach, noise and final placements.
"""

from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from brax.envs.base import State

from graphrl_jax.demonstrations import Demonstrations, reached_for_good
from graphrl_jax.runtime import jit_physics
from graphrl_jax.task import Expert
from tasks.collect import collect
from tasks.match_regions import driving, geometry, raster
from tasks.match_regions.env import MatchRegionsEnv
from tasks.match_regions.layouts import NUM_TARGETS, World, blocks
from tasks.match_regions.objects import class_ids
from tasks.match_regions.paths import direction, distances
from tasks.match_regions.state import PhysicsState, placed_targets, score

APPROACH, FACE, ADVANCE, GRIP, CARRY, RELEASE, BACK_OFF = range(7)
HELD_DISTANCE = 0.335
CLEAR_DISTANCE = 0.52
MAX_JOBS = 2
TAIL_FRAMES = 4
# Distance of goals from the region's border; a goal is the nearest such place to the target.
_INSET = 0.12
_APART = 0.3
_OPEN_PLACE = 0.85
# Distance from the standoff at which the fingers open.
_OPENS = 0.25
_OUTSIDE = 9.0
BATCH, MAX_BATCHES = 64, 16
FAILURES = ("one_target", "distractor_in", "target_out", "corner", "bystander", "touched", "nothing")
"""Kinds of deliberate failure: only one target placed; a distractor dragged in instead of the second target; a target
placed and dragged out again; a target dragged past the region into a corner; one target placed and then a distractor
dragged elsewhere; both targets only set in motion; nothing touched. `bystander` and `touched` score well under rewards
that take activity for progress."""


_KINDS_OF_TWO = [1 + FAILURES.index(name) for name in ("one_target", "touched")]
_KINDS_OF_DISTRACTORS = [1 + FAILURES.index(name) for name in ("distractor_in", "bystander")]


class Plan(NamedTuple):
    """The plan of one episode.

    | field    | shape  | meaning                                                          |
    |----------|--------|------------------------------------------------------------------|
    | block    | (J,)   | int32, index of the block of each job                            |
    | goal     | (J, 2) | goal of the block                                                |
    | jobs     | ()     | int32, number of the J jobs to do                                |
    | speed    | ()     | share of full speed                                              |
    | aside    | (J,)   | radians by which the sides that blocks may be gripped from turn  |
    | pause    | ()     | int32, idle steps before each job                                |
    | noise    | ()     | standard deviation of the noise on speed and turn                |
    """

    block: jax.Array
    goal: jax.Array
    jobs: jax.Array
    speed: jax.Array
    aside: jax.Array
    pause: jax.Array
    noise: jax.Array


class PlanState(NamedTuple):
    """Progress in a plan.

    | field | shape | dtype   | meaning                                                          |
    |-------|-------|---------|------------------------------------------------------------------|
    | job   | ()    | int32   | index of the job                                                 |
    | phase | ()    | int32   | its phase                                                        |
    | timer | ()    | int32   | steps spent in the phase                                         |
    | side  | (2,)  | float32 | direction from the block to where the robot grips it from        |
    """

    job: jax.Array
    phase: jax.Array
    timer: jax.Array
    side: jax.Array


def draw_plan(key: jax.Array, kind: jax.Array, qpos: jax.Array, world: World) -> Plan:
    """A random plan for the blocks at `qpos`; `kind` () int32 is 0 for success, k for `FAILURES[k - 1]`."""
    order_key, goal_key, speed_key, side_key, pause_key, noise_key, distractor_key = jax.random.split(key, 7)
    targets = world.present[:NUM_TARGETS].sum()
    first = jnp.where(targets == 1, 0, jax.random.bernoulli(order_key)).astype(jnp.int32)
    second = 1 - first
    starts = blocks(qpos)[:NUM_TARGETS, :2]
    goals = _goals(starts, world.region) + jax.random.uniform(goal_key, (2, 2), minval=-0.05, maxval=0.05)
    others = world.present & (jnp.arange(world.present.shape[0]) >= NUM_TARGETS)
    distractor = jax.random.categorical(distractor_key, jnp.where(others, 0.0, -jnp.inf))
    outside, corner = _outside(world.region), _corner(world.region)
    aside = outside[1]
    nudged = starts + 0.3 * jax.vmap(driving.unit)(goals - starts)
    both, one_of_each = jnp.array([first, second]), jnp.array([first, distractor])
    jobs = [  # blocks, goals and number of jobs: success, then `FAILURES`
        (both, goals[both], targets),
        (both, goals[both], 1),
        (one_of_each, goals[both], 2),
        (jnp.array([first, first]), jnp.stack([goals[first], outside[first]]), 2),
        (both, jnp.stack([corner, corner]), 1),
        (one_of_each, jnp.stack([goals[first], aside]), 2),
        (both, nudged[both], 2),
        (both, goals[both], 0),
    ]
    block, goal, count = (jnp.stack([jnp.asarray(part) for part in parts])[kind] for parts in zip(*jobs, strict=True))
    return Plan(
        block=block,
        goal=goal,
        jobs=count,
        speed=jax.random.uniform(speed_key, minval=0.9, maxval=1.0),
        aside=jax.random.uniform(side_key, (MAX_JOBS,), minval=-0.1, maxval=0.1),
        pause=jax.random.randint(pause_key, (), 0, 3),
        noise=jax.random.uniform(noise_key, minval=0.0, maxval=0.08),
    )


def _goals(starts: jax.Array, region: jax.Array) -> jax.Array:
    """Goals of targets at `starts` (2, 2): the nearest places well inside the region, apart from each other."""
    low, high = geometry.region_corners(region)
    nearest = jnp.clip(starts, (low + _INSET)[None], (high - _INSET)[None])
    opposite = low + high - nearest[0]
    close = jnp.linalg.norm(nearest[1] - nearest[0]) < _APART
    return nearest.at[1].set(jnp.where(close, opposite, nearest[1]))


def _outside(region: jax.Array) -> jax.Array:
    """Two places beside the region, on its roomier sides: (2, 2)."""
    low, high = geometry.region_corners(region)
    centre = (low + high) / 2
    beside = jnp.clip(jnp.where(centre > 0, low - _APART, high + _APART), -_OPEN_PLACE, _OPEN_PLACE)
    return jnp.stack([jnp.stack([centre[0], beside[1]]), jnp.stack([beside[0], centre[1]])])


def _corner(region: jax.Array) -> jax.Array:
    """The corner of the arena behind the region: (2,)."""
    return _OPEN_PLACE * jnp.where(geometry.region_centre(region) > 0, 1.0, -1.0)


def begin() -> PlanState:
    """The plan state at the start of an episode."""
    zero = jnp.zeros((), jnp.int32)
    return PlanState(zero, zero, zero, jnp.zeros(2))


def act(
    plan: Plan, plan_state: PlanState, qpos: jax.Array, region: jax.Array, key: jax.Array
) -> tuple[PlanState, jax.Array]:
    """One decision of the expert at `qpos` (5 + 3M,): the next plan state and an action (3,)."""
    job = jnp.minimum(plan_state.job, MAX_JOBS - 1)
    block, goal = blocks(qpos)[plan.block[job], :2], plan.goal[job]
    robot, ahead = qpos[:2], geometry.heading(qpos[2])
    phase = plan_state.phase
    side, standoff, way = _route(plan_state, qpos, plan.block[job], goal, plan.aside[job])

    cruise = driving.go_to(qpos, standoff, way, -side)
    far = jnp.linalg.norm(standoff - robot)
    facing = driving.bearing(ahead, block - robot)
    turn_to_block = driving.turn(facing)
    held = jnp.linalg.norm(block - robot)
    to_goal = jnp.linalg.norm(goal - block)
    # A block has also arrived if it is inside and the robot is at the wall.
    stopped = (jnp.max(jnp.abs(robot)) > driving.AT_WALL) & geometry.inside_region(region, block)
    arrived = (to_goal < 0.05) | ((to_goal < 0.15) & stopped)
    by_phase = jnp.stack(
        [
            jnp.append(cruise, jnp.where(far < _OPENS, 1.0, -1.0)),
            jnp.stack([0.0, turn_to_block, 1.0]),
            jnp.stack([jnp.clip((held - 0.3) * 8, 0.4, 1.0) * jnp.exp(-((facing / 0.15) ** 2)), turn_to_block, 1.0]),
            jnp.array([0.1, 0.0, -1.0]),
            jnp.append(driving.carry(ahead, way, to_goal), -1.0),
            jnp.array([0.0, 0.0, 1.0]),
            jnp.array([-1.0, 0.0, 1.0]),
        ]
    )
    finished = jnp.stack(
        [
            (far < 0.15) | (plan_state.timer > 40),
            jnp.abs(facing) < 0.15,
            (held < HELD_DISTANCE) | (plan_state.timer > 12),
            plan_state.timer >= 1,
            arrived | (plan_state.timer > 40) | (held > 0.5),
            plan_state.timer >= 1,
            (held > CLEAR_DISTANCE) | (plan_state.timer > 5),
        ]
    )
    waiting = (phase == APPROACH) & (plan_state.timer < plan.pause)
    done = plan_state.job >= plan.jobs
    action = jnp.where(waiting | done, jnp.array([0.0, 0.0, 1.0]), by_phase[phase])
    drives = jnp.isin(phase, jnp.array([APPROACH, ADVANCE, CARRY])) & ~waiting & ~done
    noise = plan.noise * jax.random.normal(key, (2,)) * drives
    action = jnp.clip(action.at[0].mul(plan.speed).at[:2].add(noise), -1.0, 1.0)

    advance = finished[phase] & ~waiting & ~done
    # A block that slipped away is approached again.
    lost = (phase == CARRY) & ~arrived & (held > 0.5)
    # After the last job the robot releases the block and stays.
    last = (phase == RELEASE) & (job == plan.jobs - 1)
    following = jnp.where((phase == BACK_OFF) | last | lost, APPROACH, phase + 1)
    next_job = plan_state.job + (advance & ((phase == BACK_OFF) | last))
    next_phase = jnp.where(advance, following, phase)
    return PlanState(next_job, next_phase, jnp.where(advance, 0, plan_state.timer + 1), side), action


def _route(
    plan_state: PlanState, qpos: jax.Array, held: jax.Array, goal: jax.Array, aside: jax.Array
) -> tuple[jax.Array, jax.Array, jax.Array]:
    """The side that a job's block is gripped from, the standoff there, and the direction of the way ahead; (2,) each.

    There is one map a step: of ways from the robot when the job begins, which decide on the side; then of ways to the
    standoff, round all blocks; at last of ways to the goal, round the blocks other than the one that is `held`.

    Args:
      plan_state: the current one.
      qpos: (5 + 3M,).
      held: () int32, index of the job's block.
      goal: (2,), where the block goes.
      aside: see `Plan`.
    """
    places, robot = blocks(qpos)[:, :2], qpos[:2]
    block = places[held]
    begins, carries = (plan_state.phase == APPROACH) & (plan_state.timer == 0), plan_state.phase == CARRY
    obstacles = jnp.where(carries, places.at[held].set(_OUTSIDE), places)
    known = driving.within(block + driving.STANDOFF * plan_state.side)
    end = jnp.where(begins, robot, jnp.where(carries, goal, known))
    lengths = distances(obstacles, end)
    side = jnp.where(begins, driving.quickest_side(lengths, robot, block, goal, aside), plan_state.side)
    standoff = driving.within(block + driving.STANDOFF * side)
    onwards = direction(lengths, jnp.where(carries, block, robot), end)
    return side, standoff, jnp.where(begins, standoff - robot, onwards)


def as_policy() -> Expert:
    """The expert with plans of successes."""

    def start(state: State, key: jax.Array) -> tuple[Plan, PlanState]:
        physics = state.pipeline_state
        return draw_plan(key, jnp.zeros((), jnp.int32), physics.qpos, physics.world), begin()

    def decide(memory: tuple[Plan, PlanState], state: State, key: jax.Array) -> tuple[Any, jax.Array]:
        physics, (plan, plan_state) = state.pipeline_state, memory
        plan_state, action = act(plan, plan_state, physics.qpos, physics.world.region, key)
        return (plan, plan_state), action

    return Expert(start, decide)


@partial(jit_physics, static_argnums=0)
def rollouts(task: MatchRegionsEnv, key: jax.Array, kinds: jax.Array) -> tuple[jax.Array, World, jax.Array]:
    """Runs one episode of each kind in `kinds` (B,) side by side.

    Returns:
      qpos of every frame (B, T + 1, 5 + 3M), the scenes (B, ...), and the number of frames in which each plan was busy
      (B,) int32.
    """
    reset_key, plan_key, act_key = jax.random.split(key, 3)
    batch = kinds.shape[0]
    physics = jax.vmap(lambda key: task.reset(key).pipeline_state)(jax.random.split(reset_key, batch))
    plans = jax.vmap(draw_plan)(jax.random.split(plan_key, batch), kinds, physics.qpos, physics.world)
    plan_state = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (batch, *leaf.shape)), begin())

    def step(carry: tuple[PhysicsState, PlanState], key: jax.Array) -> tuple:
        physics, plan_state = carry
        keys = jax.random.split(key, batch)
        plan_state, actions = jax.vmap(act)(plans, plan_state, physics.qpos, physics.world.region, keys)
        physics = jax.vmap(task.advance)(physics, actions)
        return (physics, plan_state), (physics.qpos, plan_state.job < plans.jobs)

    start, world = physics.qpos, physics.world
    keys = jax.random.split(act_key, task.episode_length)
    _, (qpos, busy) = jax.lax.scan(step, (physics, plan_state), keys)
    frames = jnp.concatenate([start[None], qpos]).swapaxes(0, 1)
    return frames, world, jnp.sum(busy, axis=0, dtype=jnp.int32)


def demonstrate(
    task: MatchRegionsEnv, key: jax.Array, successes: int, failures: int, image_size: int | None
) -> Demonstrations:
    """Runs the expert until it has demonstrations that really succeed and failures that really fail; see `collect`."""

    def run(key: jax.Array, kinds: np.ndarray) -> tuple[tuple[np.ndarray, World, np.ndarray], np.ndarray]:
        episodes = jax.tree.map(np.asarray, rollouts(task, key, jnp.asarray(kinds)))
        qpos, world, _ = episodes
        solved = np.asarray(jax.vmap(score)(qpos[:, -1], world)) == 1.0
        # A failure without the blocks of its kind counts as solved, so that it is dropped.
        lacking = ~world.present[:, 1] & np.isin(kinds, _KINDS_OF_TWO)
        lacking |= ~world.present[:, NUM_TARGETS:].any(1) & np.isin(kinds, _KINDS_OF_DISTRACTORS)
        return episodes, solved | lacking

    batches = max(MAX_BATCHES, 8 * (successes + failures) // BATCH)
    (qpos, world, busy), kinds = collect(run, key, successes, failures, len(FAILURES), BATCH, batches)
    demos = _as_demonstrations(task, qpos, world, busy, kinds)
    return demos if image_size is None else replace(demos, frames=_images(qpos, world, image_size))


def _images(qpos: np.ndarray, world: World, size: int) -> np.ndarray:
    """Images (B, T, size, size, 3) uint8 of episodes."""

    def draw(qpos: jax.Array, world: World) -> jax.Array:
        return jnp.round(255 * raster.image(qpos, world, size)).astype(jnp.uint8)

    drawn = jax.jit(jax.vmap(draw, in_axes=(0, None)))
    return np.stack([drawn(frames, jax.tree.map(lambda leaf, i=i: leaf[i], world)) for i, frames in enumerate(qpos)])


def _as_demonstrations(
    task: MatchRegionsEnv, qpos: np.ndarray, world: World, busy: np.ndarray, kinds: np.ndarray
) -> Demonstrations:
    every_frame = (0, None)
    found, mask = jax.jit(jax.vmap(jax.vmap(task.scene_boxes, every_frame)))(qpos, world)
    placed = np.asarray(jax.vmap(jax.vmap(placed_targets, every_frame))(qpos, world))
    reached = np.concatenate([placed, placed.all(-1, keepdims=True)], -1)
    # A plan without jobs lasts for the whole episode; its robot stands still.
    lengths = np.where(kinds == 1 + FAILURES.index("nothing"), qpos.shape[1], busy + TAIL_FRAMES)
    lengths = np.minimum(lengths, qpos.shape[1]).astype(np.int32)
    return Demonstrations(
        boxes=np.asarray(found),
        mask=np.asarray(mask),
        lengths=lengths,
        success=kinds == 0,
        objects=task.objects,
        frame_rate=task.frame_rate,
        source="scripted expert",
        task=task.name,
        classes=None if task.layout.fixed else np.asarray(jax.vmap(class_ids)(world)),
        events=reached_for_good(reached, lengths),
        event_names=task.event_names,
        kinds=np.array(("success", *FAILURES))[kinds],
    )
