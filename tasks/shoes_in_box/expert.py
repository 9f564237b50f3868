"""The scripted expert: opens the lid along its arc, then fetches one shoe after the other, all episodes side by side.

It does three jobs in phases: the lid, the first shoe, the second shoe. A phase defines a pose of the gripper, the
opening of its fingers, and when it is over. In a failure a job goes wrong: that of the lid, or of the first shoe, the
second or both. The failure then continues as if nothing had happened, or persists and does the same job wrong again.
Failures of the kinds in `exploits.py` may leave out the job of the lid, take turns with the shoes for ever, or never
leave a phase. Failures last as long as successes, so that length alone tells nothing.
"""

import math
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
from tasks.shoes_in_box import geometry, kinematics, render
from tasks.shoes_in_box.env import CLOSED, SPEED, TURN_RATE, ShoesInBoxEnv, grip_of
from tasks.shoes_in_box.exploits import ASIDE, EXPLOITS, HALF_OPEN, HELD_HEIGHTS, LAID_HEIGHT, knock, push
from tasks.shoes_in_box.model import CONTROL_DT, FINGER_OPEN, LID_OPEN, WALL_HEIGHT
from tasks.shoes_in_box.state import PhysicsState, shoes, success
from tasks.shoes_in_box.state import events as events_of

LID_PHASES = ("above_bar", "at_bar", "grip", "arc", "let_go", "off")
SHOE_PHASES = ("above_shoe", "at_shoe", "grip", "lift", "over_box", "lower", "let_go", "off")
_JOB_ENDS = jnp.cumsum(jnp.array([len(LID_PHASES), len(SHOE_PHASES), len(SHOE_PHASES)]))
_JOB_STARTS = jnp.append(0, _JOB_ENDS[:-1])
NUM_PHASES = len(LID_PHASES) + 2 * len(SHOE_PHASES)
SAFE_HEIGHT = 0.19
GRASP_HEIGHT = 0.04
RELEASE_HEIGHT = WALL_HEIGHT - 0.02
SLOT = 0.07
"""Distance of the shoes' centres from the box's middle, along the hinge."""
ARC_LEAD = 0.12
BAR_OPENING = 0.022
MISSED_BY = 0.05
"""Height above the bar or a shoe at which the fingers close in a failure, metres."""
# Share of full speed in each phase; a faster shove throws the shoe over.
_SPEEDS = jnp.ones(NUM_PHASES).at[LID_PHASES.index("arc")].set(0.6)
_SWEEP_SPEEDS = jnp.array([*len(LID_PHASES) * [1.0], *2 * [1.0, 1.0, 1.0, 0.3, 0.3, 0.3, 1.0, 1.0]])
# Radians per step of the arc if the lid is missed.
_SWING = 0.045
_MIDDLE_YAW = jnp.pi / 4
TAIL_FRAMES = (10, 40)
"""Range of the number of frames after the last motion, drawn uniformly."""
BATCH, MAX_BATCHES = 64, 8
FAILURES = ("lid_missed", "lid_falls_shut", "shoe_missed", "shoe_dropped", "shoe_beside", "one_shoe", *EXPLOITS)
"""Kinds of deliberate failure: the fingers close above the bar; the lid is let go before it stands up; the fingers
close above a shoe; a shoe is dropped on its way; it is put down beside the box; one shoe is left alone, and the gripper
moves through the air high above it. The last ones are `EXPLOITS`."""
_KIND = {kind: 1 + index for index, kind in enumerate(FAILURES)}
# Kinds that leave the lid shut; of these, those whose gripper stays closed and goes from shoe to shoe for ever.
_SHUT = ("shoes_knocked", "shoe_on_lid", "box_pushed")
_SWEEPS = ("shoes_knocked", "box_pushed")


class Plan(NamedTuple):
    """The plan of one episode.

    | field    | shape  | meaning                                                          |
    |----------|--------|------------------------------------------------------------------|
    | kind     | ()     | int32, 0 for a success, k for `FAILURES[k - 1]`                  |
    | wrong    | (3,)   | bool, whether the job of the lid, first and second shoe fails    |
    | start    | ()     | int32, the first phase                                           |
    | after    | (3,)   | int32, the phase that follows each job, P for none               |
    | first    | ()     | int32, the shoe that is fetched first                            |
    | slots    | (2,)   | where each shoe goes: metres along the hinge from the middle     |
    | speed    | ()     | share of full speed                                              |
    | height   | ()     | additional height between places, metres                         |
    | dwell    | (P,)   | int32, idle steps after each phase                               |
    | slip     | (2,)   | shares that set where the lid is let go and a shoe is dropped    |
    """

    kind: jax.Array
    wrong: jax.Array
    start: jax.Array
    after: jax.Array
    first: jax.Array
    slots: jax.Array
    speed: jax.Array
    height: jax.Array
    dwell: jax.Array
    slip: jax.Array


class PlanState(NamedTuple):
    """Progress in a plan.

    | field | shape  | meaning                                                   |
    |-------|--------|-----------------------------------------------------------|
    | phase | ()     | int32, 0 to P, P when done                                |
    | timer | ()     | int32, steps spent in the phase                           |
    | dwelt | ()     | int32, steps spent dwelling after it                      |
    | found | (2, 7) | free joints of the shoes in the first phase of this job   |
    """

    phase: jax.Array
    timer: jax.Array
    dwelt: jax.Array
    found: jax.Array


def _is(kind: jax.Array, *names: str) -> jax.Array:
    """Whether a kind is one of these: () bool."""
    return jnp.isin(kind, jnp.array([_KIND[name] for name in names]))


def draw_plan(key: jax.Array, kind: jax.Array) -> Plan:
    """A random plan of one kind."""
    order_key, cross_key, speed_key, height_key, dwell_key, slip_key, wrong_key, persist_key = jax.random.split(key, 8)
    side = jnp.array([SLOT, -SLOT])
    # `one_shoe` leaves the first or the second shoe alone, `shoe_held` puts the first into the box, and failures that
    # leave the lid shut affect both shoes.
    leaves_one, shut = kind == _KIND["one_shoe"], _is(kind, *_SHUT)
    which = jax.random.randint(wrong_key, (), 0, jnp.where(leaves_one, 2, 3))
    which = jnp.where(shut, 2, jnp.where(kind == _KIND["shoe_held"], 1, which))
    lid = _is(kind, "lid_missed", "lid_falls_shut", "lid_half_open")
    shoe = (kind > 0) & ~lid
    wrong = jnp.stack([lid, shoe & (which != 1), shoe & (which != 0)])
    persists = jax.random.bernoulli(persist_key) & ~leaves_one & ~_is(kind, *EXPLOITS)
    after = jnp.where(persists & wrong, _JOB_STARTS, _JOB_ENDS)
    return Plan(
        kind=kind,
        wrong=wrong,
        start=jnp.where(shut, _JOB_STARTS[1], 0),
        after=after.at[2].set(jnp.where(_is(kind, *_SWEEPS), _JOB_STARTS[1], after[2])),
        first=jax.random.bernoulli(order_key).astype(jnp.int32),
        slots=jnp.where(jax.random.bernoulli(cross_key, 0.2), -side, side),
        speed=jax.random.uniform(speed_key, minval=0.8, maxval=1.0),
        height=jax.random.uniform(height_key, minval=0.0, maxval=0.05),
        dwell=jax.random.randint(dwell_key, (NUM_PHASES,), 0, 4),
        slip=jax.random.uniform(slip_key, (2,)),
    )


def begin(plan: Plan) -> PlanState:
    """The plan state at the start of an episode."""
    zero = jnp.zeros((), jnp.int32)
    return PlanState(plan.start, zero, zero, jnp.zeros((2, 7)))


def act(plan: Plan, plan_state: PlanState, state: PhysicsState) -> tuple[PlanState, jax.Array]:
    """One decision of the expert: the next plan state and an action (5,)."""
    phase = jnp.minimum(plan_state.phase, NUM_PHASES - 1)
    found = jnp.where(jnp.isin(phase, _JOB_STARTS), shoes(state.qpos), plan_state.found)
    plan_state = plan_state._replace(found=found)
    poses, openings, over = _phases(plan, plan_state, state)
    pose, opening = poses[phase], openings[phase]
    waiting = (plan_state.dwelt > 0) | (plan_state.phase >= NUM_PHASES)
    offset = pose - state.target
    reach = jnp.linalg.norm(offset[:3])
    pace = CONTROL_DT * SPEED
    speed = plan.speed * jnp.where(_is(plan.kind, *_SWEEPS), _SWEEP_SPEEDS, _SPEEDS)[phase]
    linear = offset[:3] * jnp.minimum(1 / pace, speed / jnp.maximum(reach, 1e-6))
    turn = offset[3] / (CONTROL_DT * TURN_RATE)
    grip = grip_of(opening)
    motion = jnp.where(waiting, 0.0, jnp.append(linear, jnp.clip(turn, -plan.speed, plan.speed)))
    action = jnp.clip(jnp.append(motion, grip), -1.0, 1.0)

    finished = over[phase] & (plan_state.phase < NUM_PHASES)
    dwelt = jnp.where(finished | (plan_state.dwelt > 0), plan_state.dwelt + 1, 0)
    advance = dwelt > plan.dwell[phase]
    timer = jnp.where(advance, 0, plan_state.timer + 1)
    job = jnp.searchsorted(_JOB_STARTS, phase, side="right") - 1
    following = jnp.where(phase + 1 == _JOB_ENDS[job], plan.after[job], phase + 1)
    next_phase = jnp.where(advance, following, plan_state.phase)
    return PlanState(next_phase, timer, jnp.where(advance, 0, dwelt), found), action


def _phases(plan: Plan, plan_state: PlanState, state: PhysicsState) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Pose (P, 4), opening of the fingers (P,) and end condition (P,) of every phase in the current state."""
    jobs = [_lid_phases(plan, plan_state, state)] + [
        _shoe_phases(plan, plan_state, state, last) for last in (False, True)
    ]
    poses, openings, over = (jnp.concatenate(parts) for parts in zip(*jobs, strict=True))
    return poses, openings, over


def _turned(yaw: jax.Array) -> jax.Array:
    """The yaw of the same grip, turned by half turns to keep the wrist near the middle of its range."""
    return yaw - jnp.pi * jnp.round((yaw - _MIDDLE_YAW) / jnp.pi)


def _reached(state: PhysicsState, pose: jax.Array, timer: jax.Array) -> jax.Array:
    """Whether the target is at a pose and the arm is near it, or the phase has taken more than 80 steps."""
    offset = pose - state.target
    sent = (jnp.linalg.norm(offset[:3]) < 2e-3) & (jnp.abs(offset[3]) < 0.02)
    near = jnp.linalg.norm(kinematics.pose(state.qpos[:7])[:3] - pose[:3]) < 0.015
    return (sent & near) | (timer > 80)


def _between(limits: tuple[float, float], share: jax.Array) -> jax.Array:
    return limits[0] + (limits[1] - limits[0]) * share


def _lid_phases(plan: Plan, plan_state: PlanState, state: PhysicsState) -> tuple[jax.Array, ...]:
    box, angle, timer = state.box, state.qpos[9], plan_state.timer
    missed, half = plan.kind == _KIND["lid_missed"], plan.kind == _KIND["lid_half_open"]
    # If the bar is missed, the arc goes through the air above it and follows the timer.
    swung = jnp.where(missed, jnp.minimum(timer * _SWING, LID_OPEN), angle)
    above = jnp.zeros(3).at[2].set(jnp.where(missed, MISSED_BY, 0.0))
    bar = geometry.bar(box, angle) + above
    stop = jnp.where(half, _between(HALF_OPEN, plan.slip[0]), LID_OPEN + 0.03)
    places = jnp.stack(
        [
            bar.at[2].add(0.1),
            bar,
            bar,
            geometry.bar(box, jnp.minimum(swung + ARC_LEAD, stop)) + above,
            state.target[:3],
            state.target[:3].at[2].add(0.1),
        ]
    )
    poses = jnp.concatenate([places, jnp.full((len(places), 1), _turned(box[2] + jnp.pi / 2))], axis=1)
    astride, closed = BAR_OPENING + 0.01, CLOSED
    openings = jnp.array([astride, astride, closed, closed, BAR_OPENING, BAR_OPENING])
    let_go_at = jnp.where(plan.kind == _KIND["lid_falls_shut"], 0.5 + 0.7 * plan.slip[0], LID_OPEN - 0.06)
    over = jnp.stack(
        [
            _reached(state, poses[0], timer),
            _reached(state, poses[1], timer),
            timer >= 6,
            ((swung > let_go_at) | (timer > 120)) & ~half,
            timer >= 5,
            timer >= 6,
        ]
    )
    return poses, openings, over


def _shoe_phases(plan: Plan, plan_state: PlanState, state: PhysicsState, last: bool) -> tuple[jax.Array, ...]:
    number = 1 - plan.first if last else plan.first
    timer, box = plan_state.timer, state.box
    shoe = shoes(state.qpos)[number]

    def fails(kind: str) -> jax.Array:
        return plan.wrong[2 if last else 1] & (plan.kind == _KIND[kind])

    high = SAFE_HEIGHT + plan.height
    down = GRASP_HEIGHT + jnp.where(fails("shoe_missed"), MISSED_BY, 0.0) + jnp.where(fails("one_shoe"), 0.1, 0.0)
    shoe_yaw, box_yaw = _turned(geometry.shoe_yaw(shoe)), _turned(box[2])
    frame, slot = geometry.box_pose(box), plan.slots[number]
    outside = frame.place(jnp.stack([-0.05, jnp.sign(slot) * 0.27, GRASP_HEIGHT + 0.01]))
    held, knocked, pushed = fails("shoe_held"), fails("shoes_knocked"), fails("box_pushed")
    height = jnp.where(held, _between(HELD_HEIGHTS, plan.slip[0]), RELEASE_HEIGHT)
    height = jnp.where(fails("shoe_on_lid"), LAID_HEIGHT, height)
    goal = jnp.where(fails("shoe_beside"), outside, frame.place(jnp.stack([0.0, slot, height])))

    def at(place: jax.Array, height: jax.Array | float, yaw: jax.Array) -> jax.Array:
        return jnp.concatenate([place[:2], jnp.stack([jnp.asarray(height, jnp.float32), yaw])])

    poses = jnp.stack(
        [
            at(shoe, high, shoe_yaw),
            at(shoe, down, shoe_yaw),
            state.target,
            state.target.at[2].set(high),
            at(goal, high, box_yaw),
            at(goal, goal[2], box_yaw),
            at(goal, goal[2], box_yaw),
            at(goal, high, box_yaw),
        ]
    )
    sweeps, here = knocked | pushed, state.target[:3]
    swept = jnp.where(
        knocked,
        knock(plan_state.found[number], box, here, high, _between(ASIDE, plan.slip[0])),
        push(number, box, here, high, jnp.sign(slot)),
    )
    yaw = jnp.where(knocked, box_yaw, _turned(box[2] + jnp.pi / 2))
    poses = jnp.where(sweeps, jnp.concatenate([swept, jnp.full((len(swept), 1), yaw)], axis=1), poses)
    near = jnp.linalg.norm(state.target[:2] - goal[:2]) < 0.14 + 0.1 * plan.slip[1]
    carried = jnp.where(fails("shoe_dropped") & near, FINGER_OPEN, CLOSED)
    open_, closed = FINGER_OPEN, CLOSED
    openings = jnp.array([open_, open_, closed, closed, 0.0, 0.0, open_, open_]).at[4:6].set(carried)
    openings = jnp.where(sweeps, closed, openings)
    reached = jax.vmap(_reached, in_axes=(None, 0, None))(state, poses, timer)
    return poses, openings, reached.at[2].set(timer >= 6).at[5].set(reached[5] & ~held).at[6].set(timer >= 5)


def as_policy() -> Expert:
    """The expert with plans of successes."""

    def start(state: State, key: jax.Array) -> tuple[Plan, PlanState]:
        plan = draw_plan(key, jnp.zeros((), jnp.int32))
        return plan, begin(plan)

    def decide(memory: tuple[Plan, PlanState], state: State, key: jax.Array) -> tuple[Any, jax.Array]:
        plan, plan_state = memory
        plan_state, action = act(plan, plan_state, state.pipeline_state)
        return (plan, plan_state), action

    return Expert(start, decide)


def episodes(task: ShoesInBoxEnv, key: jax.Array, kinds: jax.Array) -> tuple[PhysicsState, jax.Array]:
    """Runs one episode of each kind in `kinds` (B,) side by side; not compiled.

    Returns:
      The physics state of every frame, leaves (B, T + 1, ...), and the number of frames in which each plan was busy
      (B,) int32.
    """
    reset_key, plan_key = jax.random.split(key)
    batch = kinds.shape[0]
    physics = jax.vmap(lambda key: task.reset(key).pipeline_state)(jax.random.split(reset_key, batch))
    plans = jax.vmap(draw_plan)(jax.random.split(plan_key, batch), kinds)
    plan_state = jax.vmap(begin)(plans)

    def step(carry: tuple, _: None) -> tuple:
        physics, plan_state = carry
        plan_state, actions = jax.vmap(act)(plans, plan_state, physics)
        physics = jax.vmap(task.advance)(physics, actions)
        return (physics, plan_state), (physics, plan_state.phase < NUM_PHASES)

    _, (states, busy) = jax.lax.scan(step, (physics, plan_state), length=task.episode_length)
    frames = jax.tree.map(lambda first, rest: jnp.concatenate([first[None], rest]).swapaxes(0, 1), physics, states)
    return frames, jnp.sum(busy, axis=0, dtype=jnp.int32)


rollouts = jit_physics(episodes, static_argnums=0)
"""`episodes`, compiled. Inside another compiled program use `episodes`: it sets no compiler options."""


def demonstrate(
    task: ShoesInBoxEnv, key: jax.Array, successes: int, failures: int, image_size: int | None
) -> Demonstrations:
    """Runs the expert until it has demonstrations that really succeed and failures that really fail; see `collect`.

    Raises:
      ValueError: images are requested, but this machine cannot render.
    """
    if image_size is not None and not render.can_render():
        raise ValueError("images of shoes_in_box need a graphics library that MuJoCo can use; there is none here")
    collect_key, length_key = jax.random.split(key)

    def run(key: jax.Array, kinds: np.ndarray) -> tuple[Any, np.ndarray]:
        states, busy = jax.tree.map(np.asarray, rollouts(task, key, jnp.asarray(kinds)))
        last = jax.tree.map(lambda leaf: leaf[:, -1], states)
        found = *jax.tree.map(np.asarray, seen(task, states)), busy, states.qpos, states.box
        return found, np.asarray(jax.vmap(success)(last))

    # A few episodes do not need a whole batch.
    batch = min(BATCH, 8 * math.ceil((successes + failures) / 8))
    (boxes, mask, events, busy, qpos, box), kinds = collect(
        run, collect_key, successes, failures, len(FAILURES), batch, MAX_BATCHES
    )
    # A failure gets the length of a random success, whenever its own motions end.
    tail_key, draw_key = jax.random.split(length_key)
    tails = np.asarray(jax.random.randint(tail_key, busy.shape, *TAIL_FRAMES))
    lengths = np.minimum(busy + tails, boxes.shape[1])
    drawn = np.asarray(jax.random.choice(draw_key, lengths[kinds == 0], kinds.shape)) if successes else lengths
    lengths = np.where(kinds == 0, lengths, drawn).astype(np.int32)
    return Demonstrations(
        boxes=boxes,
        mask=mask,
        lengths=lengths,
        success=kinds == 0,
        objects=task.objects,
        frame_rate=task.frame_rate,
        source="scripted expert",
        task=task.name,
        events=reached_for_good(events, lengths),
        event_names=task.event_names,
        kinds=np.array(("success", *FAILURES))[kinds],
        frames=None if image_size is None else _images(qpos, box, image_size),
    )


def _images(qpos: np.ndarray, box: np.ndarray, size: int) -> np.ndarray:
    """The camera's images (B, T, size, size, 3) uint8 of episodes."""
    episodes = zip(qpos, box, strict=True)
    return np.stack(
        [[render.draw_scene(*frame, size, shadows=False) for frame in zip(*one, strict=True)] for one in episodes]
    )


@partial(jax.jit, static_argnums=0)
def seen(task: ShoesInBoxEnv, states: PhysicsState) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Boxes (B, T, N, 4), mask (B, T, N) and events (B, T, E) of physics states (B, T, ...)."""
    return jax.vmap(jax.vmap(lambda state: (*task.look(state), events_of(state))))(states)
