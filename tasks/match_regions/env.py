"""Match Regions as a Brax environment on MJX: put the green star and the green square into the green region.

Action (3,) in [-1, 1]: speed (0.8 units/s forwards, 0.6 backwards), turn (2.5 rad/s, counter-clockwise positive) and
gripper (closed below 0, open from 0 on): MAGICAL's controls with continuous speed and turn.

Observation (57,), lengths in arena units, "ahead" and "left" in the robot's frame:

    0:6     robot x, y, sin and cos of its angle, finger openings / (pi / 8)
    6:11    robot velocity ahead and left, turn rate, finger rates
    11:13   centre of the goal region: ahead, left
    13:24   the target to see to: position of its centre ahead, left; sine and cosine of its angle against the robot's;
            velocity ahead, left; whether its centre is inside the region; its distance from the robot's centre and the
            direction towards it (ahead, left); its distance to the region at the start of the episode
    24:35   the other target, likewise
    35:36   1 if the target to see to is the star, else 0
    36:57   for each distractor, the first seven of these numbers

The target to see to is the nearer one of those outside the region, or the nearer one if both are inside or outside.
What a policy learns about bringing one target so holds for the other as well.
"""

import dataclasses
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from brax.envs.base import State
from mujoco import mjx

from graphrl_jax.demonstrations import Demonstrations
from graphrl_jax.detection import Detector
from graphrl_jax.graph import ObjectTable, safe_norm
from graphrl_jax.landscape import Landscape
from graphrl_jax.task import Task
from tasks.match_regions import geometry, layouts, magical
from tasks.match_regions.model import (
    BLOCK_NAMES,
    CONTROL_DT,
    DRIVEN_MASS,
    FINGER_OPEN,
    ROBOT_RADIUS,
    Physics,
    build_model,
)

NUM_TARGETS = 2
FORWARD_SPEED, BACKWARD_SPEED, TURN_RATE, FINGER_RATE = 4 * ROBOT_RADIUS, 3 * ROBOT_RADIUS, 2.5, 1.0
CLASS_NAMES = (
    "goal_region", "robot", "green_star", "green_square", "blue_pentagon", "yellow_circle", "yellow_pentagon",
)  # fmt: skip
OBJECTS = ObjectTable(
    names=("goal_region", "robot", *BLOCK_NAMES, "spare"),
    class_ids=(0, 1, 2, 3, 4, 5, 6, 0),
    is_robot=(False, True) + (False,) * 6,
    class_names=CLASS_NAMES,
    is_fixture=(True,) + (False,) * 7,
)


class PhysicsState(NamedTuple):
    """What is carried from step to step; the rest of `mjx.Data` is rebuilt from a template.

    | field            | shape | dtype   | meaning                                                      |
    |------------------|-------|---------|--------------------------------------------------------------|
    | qpos             | (20,) | float32 | robot x, y, theta; fingers (2,); then x, y, theta per block  |
    | qvel             | (20,) | float32 | their rates                                                  |
    | warmstart        | (20,) | float32 | accelerations the solver starts from                         |
    | initial_distance | (2,)  | float32 | of each target to the region's centre at the episode's start; |
    |                  |       |         | the Demo layout's for a target that starts inside the region |
    """

    qpos: jax.Array
    qvel: jax.Array
    warmstart: jax.Array
    initial_distance: jax.Array


@dataclass(frozen=True)
class Reward:
    """Constants of the environmental reward 10 tanh(p / 2); p = progress - distractors inside - time penalty.

    `reach` is ours and not part of the original: p also loses `reach` times the way still to go to the blocks, which is
    the distance from the point between the fingers to the nearest target outside the region, plus `REACH_PER_TARGET`
    for every further one, so that placing a target never costs. 0 gives the original.
    """

    scale: float = 10.0
    time_penalty: float = 0.1
    reach: float = 0.75


class MatchRegions(Task):
    """See the module's docstring.

    Args:
      layout: where episodes start (see `layouts.py`).
      physics, reward: constants.
      targets_in_order: observe the target to see to first; otherwise the star always comes first.
      varied: share of training episodes that start part of the way to the goal (see `layouts.Training`).
      control: `discrete` takes MAGICAL's actions by number, () int, instead of ours (see `magical.action`): for replays
        and planners; policies and the expert act continuously.

    Raises:
      ValueError: another control.
    """

    name = "match_regions"
    objects = OBJECTS
    event_names = ("star_placed", "square_placed", "both_placed")
    episode_length = 120
    frame_rate = 1 / CONTROL_DT
    action_size = 3
    observation_size = 57

    def __init__(
        self,
        layout: layouts.Layout | None = None,
        physics: Physics | None = None,
        reward: Reward | None = None,
        targets_in_order: bool = True,
        varied: float = layouts.Training.varied,
        control: Literal["continuous", "discrete"] = "continuous",
    ):
        if control not in ("continuous", "discrete"):
            raise ValueError(f"control is {control!r}; allowed: 'continuous' and 'discrete'")
        self.layout = layout or layouts.Demo()
        self.physics = physics or Physics()
        self.reward = reward or Reward()
        self.targets_in_order = targets_in_order
        self.varied = varied
        self.control = control
        self.mj_model = build_model(self.physics)
        self._model = mjx.put_model(self.mj_model)
        self._template = mjx.make_data(self.mj_model)

    def reset(self, rng: jax.Array) -> State:
        qpos, moved = self.layout.sample(rng)
        zeros = jnp.zeros_like(qpos)
        # A target that starts in its place counts as brought there from where the Demo layout has it.
        placed = placed_targets(qpos)
        origin = jnp.where(placed[:, None], layouts.BLOCK_STARTS[:NUM_TARGETS, :2], blocks(qpos)[:NUM_TARGETS, :2])
        distance = jnp.linalg.norm(origin - geometry.region_centre(), axis=-1)
        physics = PhysicsState(qpos, zeros, zeros, distance)
        zero = jnp.zeros((), jnp.float32)
        metrics = {"success": zero, "score": zero}
        moved = moved.at[:NUM_TARGETS].set(moved[:NUM_TARGETS] | placed)
        active = jnp.zeros(OBJECTS.num_slots, bool).at[2 : 2 + len(BLOCK_NAMES)].set(moved)
        return State(physics, observe(physics, self.targets_in_order), zero, zero, metrics, {"active": active})

    def step(self, state: State, action: jax.Array) -> State:
        physics = self.advance(state.pipeline_state, action)
        value = score(physics.qpos)
        metrics = {**state.metrics, "success": (value == 1.0).astype(jnp.float32), "score": value}
        reward = environment_reward(physics, self.reward)
        obs = observe(physics, self.targets_in_order)
        return state.replace(pipeline_state=physics, obs=obs, reward=reward, metrics=metrics)

    def advance(self, state: PhysicsState, action: jax.Array) -> PhysicsState:
        """One control step of physics under `action` (3,), or () int where control is discrete."""
        action = magical.action(action) if self.control == "discrete" else jnp.clip(action, -1.0, 1.0)
        speed = action[0] * jnp.where(action[0] > 0, FORWARD_SPEED, BACKWARD_SPEED)
        opening = jnp.where(action[2] < 0, 0.0, FINGER_OPEN)
        finger_targets = jnp.stack([opening, -opening])

        def substep(carry: tuple, _: None) -> tuple:
            qpos, qvel, warmstart = carry
            finger_rates = jnp.clip((finger_targets - qpos[3:5]) / CONTROL_DT, -FINGER_RATE, FINGER_RATE)
            velocity = self._drive(speed * geometry.heading(qpos[2]), qvel[:2])
            ctrl = jnp.concatenate([velocity, action[1:2] * TURN_RATE, finger_rates])
            data = self._template.replace(qpos=qpos, qvel=qvel, qacc_warmstart=warmstart, ctrl=ctrl)
            data = mjx.step(self._model, data)
            return (data.qpos, data.qvel, data.qacc_warmstart), None

        carry = (state.qpos, state.qvel, state.warmstart)
        (qpos, qvel, warmstart), _ = jax.lax.scan(substep, carry, None, length=self.physics.substeps)
        return PhysicsState(qpos, qvel, warmstart, state.initial_distance)

    def _drive(self, wanted: jax.Array, velocity: jax.Array) -> jax.Array:
        """Velocity (2,) that the servos of both axes are told."""
        if not self.physics.heading_drive:
            return wanted
        # A servo gains what it lacks within one sub-step, unless its force is limited: here, that of both together.
        change = wanted - velocity
        most = self.physics.drive_force / DRIVEN_MASS * CONTROL_DT / self.physics.substeps
        return velocity + change * jnp.minimum(1.0, most / jnp.maximum(safe_norm(change), 1e-6))

    def boxes(self, state: State) -> tuple[jax.Array, jax.Array]:
        return boxes(state.pipeline_state.qpos)

    def events(self, state: State) -> jax.Array:
        placed = placed_targets(state.pipeline_state.qpos)
        return jnp.append(placed, placed.all())

    def training(self) -> "MatchRegions":
        if self.control == "discrete":
            raise ValueError("policies act continuously; allowed: control 'continuous'")
        return self._changed(layout=layouts.Training(self.layout, self.varied))

    def with_reward(self, **changes: float) -> "MatchRegions":
        """The same task with some constants of its reward changed."""
        return self._changed(reward=dataclasses.replace(self.reward, **changes))

    def _changed(self, **changes: Any) -> "MatchRegions":
        names = ("layout", "physics", "reward", "targets_in_order", "varied", "control")
        return MatchRegions(**({name: getattr(self, name) for name in names} | changes))

    def picture_detector(self) -> Detector:
        return magical.detector()

    def demonstrate(self, key: jax.Array, successes: int, failures: int = 0) -> Demonstrations:
        from tasks.match_regions.expert import demonstrate

        return demonstrate(self._changed(control="continuous"), key, successes, failures)

    def draw_episode(
        self, states: Any, boxes: np.ndarray, mask: np.ndarray, active: np.ndarray, rewards: np.ndarray, label: str
    ) -> np.ndarray:
        from tasks.match_regions.render import episode_frames

        return episode_frames(states.qpos, boxes, mask, active, rewards, size=320, label=label)

    def landscape(self, key: jax.Array) -> Landscape:
        from tasks.match_regions.scenes import landscape

        return landscape(key)


def blocks(qpos: jax.Array) -> jax.Array:
    """Poses x, y, theta of the five blocks in `qpos` (20,): (5, 3)."""
    return qpos[5:].reshape(len(BLOCK_NAMES), 3)


def placed_targets(qpos: jax.Array) -> jax.Array:
    """Whether the centre of star and square is inside the region: (2,) bool."""
    return geometry.inside_region(blocks(qpos)[:NUM_TARGETS, :2])


def boxes(qpos: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Image-plane boxes (N, 4) and mask (N,) of the scene at `qpos` (20,); the last slot is spare."""
    rows = [
        geometry.region_box()[None],
        geometry.robot_box(qpos[:3], qpos[3:5])[None],
        geometry.block_boxes(blocks(qpos)),
    ]
    present = jnp.arange(OBJECTS.num_slots) < OBJECTS.num_slots - 1
    return jnp.concatenate([*rows, jnp.zeros((1, 4))]), present


def score(qpos: jax.Array) -> jax.Array:
    """MAGICAL's score of a final state: share of targets inside times share of targets among all inside; ()."""
    inside = geometry.inside_region(blocks(qpos)[:, :2]).astype(jnp.float32)
    targets, total = inside[:NUM_TARGETS].sum(), inside.sum()
    return (targets / NUM_TARGETS) * (targets / jnp.maximum(total, 1.0))


def grasp_point(qpos: jax.Array) -> jax.Array:
    """Where a held block's centre sits, between the fingers, in the arena: (2,)."""
    return qpos[:2] + GRASP_REACH * geometry.heading(qpos[2])


GRASP_REACH = 0.32
REACH_PER_TARGET = 1.5
# More than any distance in the arena.
_PLACED_LAST = 10.0


def environment_reward(state: PhysicsState, constants: Reward) -> jax.Array:
    """The original experiments' reward of a state, plus the disclosed reach term; ()."""
    poses = blocks(state.qpos)
    inside = geometry.inside_region(poses[:, :2])
    placed = inside[:NUM_TARGETS]
    distance = jnp.linalg.norm(poses[:NUM_TARGETS, :2] - geometry.region_centre(), axis=-1)
    progress = jnp.sum(state.initial_distance - jnp.where(placed, 0.0, distance))
    distractors = inside[NUM_TARGETS:].sum()
    to_target = jnp.linalg.norm(poses[:NUM_TARGETS, :2] - grasp_point(state.qpos), axis=-1)
    nearest = jnp.where(placed.all(), 0.0, jnp.min(jnp.where(placed, jnp.inf, to_target)))
    reach = nearest + REACH_PER_TARGET * jnp.maximum(jnp.sum(~placed) - 1, 0)
    potential = progress - distractors - constants.time_penalty - constants.reach * reach
    return constants.scale * jnp.tanh(potential / NUM_TARGETS)


def observe(state: PhysicsState, targets_in_order: bool = True) -> jax.Array:
    """The observation described in the module's docstring: (57,); not `targets_in_order`, the star comes first."""
    qpos, qvel = state.qpos, state.qvel
    ahead = geometry.heading(qpos[2])
    frame = jnp.stack([ahead, jnp.stack([-ahead[1], ahead[0]])])  # world to (ahead, left)
    robot = jnp.concatenate([qpos[:2], jnp.sin(qpos[2:3]), jnp.cos(qpos[2:3]), qpos[3:5] / FINGER_OPEN])
    rates = jnp.concatenate([frame @ qvel[:2], qvel[2:3] / TURN_RATE, qvel[3:5]])
    poses = blocks(qpos)
    position = (poses[:, :2] - qpos[:2]) @ frame.T
    angle = poses[:, 2] - qpos[2]
    velocity = qvel[5:].reshape(-1, 3)[:, :2] @ frame.T
    inside = geometry.inside_region(poses[:, :2]).astype(jnp.float32)
    per_block = jnp.concatenate(
        [position, jnp.sin(angle)[:, None], jnp.cos(angle)[:, None], velocity, inside[:, None]], axis=-1
    )
    region = frame @ (geometry.region_centre() - qpos[:2])
    distance = jnp.linalg.norm(position[:NUM_TARGETS], axis=-1, keepdims=True)
    towards = position[:NUM_TARGETS] / jnp.maximum(distance, 1e-6)
    targets = jnp.concatenate([per_block[:NUM_TARGETS], distance, towards, state.initial_distance[:, None]], axis=-1)
    order = jnp.arange(NUM_TARGETS)
    if targets_in_order:
        order = jnp.argsort(distance[:, 0] + _PLACED_LAST * inside[:NUM_TARGETS])
    star_first = (order[:1] == 0).astype(jnp.float32)
    return jnp.concatenate([robot, rates, region, targets[order].ravel(), star_first, per_block[NUM_TARGETS:].ravel()])
