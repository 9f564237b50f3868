"""Shoes in Box as a Brax environment on MJX: open the box by the bar of its lid, put both shoes in, let go.

Action (5,) in [-1, 1]: velocity of the gripper along x, y, z (0.4 m/s), its turn about the vertical (2 rad/s), and
the opening of the fingers (closed at -1, 8 cm at 1). The gripper points down; a step of differential inverse kinematics
turns its pose into joint targets, 20 times a second.

Observation (46,), lengths in metres, "there" in the box's frame:

    0:5     gripper there x, y, z; sine and cosine of its yaw against the box's
    5:7     openings of the fingers / 4 cm
    7:14    the arm's joints, radians
    14:18   the box's x, y; sine and cosine of its yaw
    18:20   angle of the lid / 2 rad, its rate
    20:23   the lid's bar from the gripper
    23:45   per shoe: position there, from the gripper, sine and cosine of twice its yaw against the box's, 1 if it lies
            on its sole to -1 on its top, whether it is inside, whether a pad touches it
    45      whether the lid is open

Success: the centres of both shoes are inside the box, and no pad touches a shoe.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from brax.envs.base import State
from mujoco import mjx

from graphrl_jax.demonstrations import Demonstrations
from graphrl_jax.graph import ObjectTable
from graphrl_jax.landscape import Landscape
from graphrl_jax.pretrain import PretrainHyper
from graphrl_jax.task import Task
from tasks.detection import Detector
from tasks.shoes_in_box import geometry, kinematics
from tasks.shoes_in_box.layouts import Layout
from tasks.shoes_in_box.model import CONTROL_DT, FINGER_OPEN, LID_OPEN, SHOE_NAMES, Physics, build_model

SPEED, TURN_RATE = 0.4, 2.0
# Where the gripper may be sent, and how far ahead of the arm: metres.
WORKSPACE = np.array([[0.15, -0.5, 0.03], [0.72, 0.5, 0.45]], np.float32)
LEAD = 0.04
# Fingers told to close push on beyond each other; what they hold stops them.
CLOSED = -0.02
LID_COUNTS_AS_OPEN = 1.85
OBJECTS = ObjectTable(
    names=("gripper", "box", "lid", *SHOE_NAMES),
    class_ids=(0, 1, 2, 3, 3),
    is_robot=(True, False, False, False, False),
    class_names=("gripper", "box", "lid", "shoe"),
    is_fixture=(False, True, False, False, False),
)


class PhysicsState(NamedTuple):
    """What is carried from step to step; the rest of `mjx.Data` is rebuilt from a template.

    | field     | shape  | dtype   | meaning                                                                |
    |-----------|--------|---------|------------------------------------------------------------------------|
    | qpos      | (24,)  | float32 | arm (7), left and right finger, lid, then position and quaternion per shoe |
    | qvel      | (22,)  | float32 | their rates                                                            |
    | warmstart | (22,)  | float32 | accelerations the solver starts from                                   |
    | target    | (4,)   | float32 | where the gripper is sent: x, y, z, yaw                                |
    | arm       | (7,)   | float32 | joints that are there                                                  |
    | box       | (3,)   | float32 | x, y, yaw of the box                                                   |
    | touched   | (2,)   | bool    | a pad touches the shoe                                                 |
    | frame     | ()     | uint32  | seed of what the detector draws in this frame, one more in every frame |
    """

    qpos: jax.Array
    qvel: jax.Array
    warmstart: jax.Array
    target: jax.Array
    arm: jax.Array
    box: jax.Array
    touched: jax.Array
    frame: jax.Array


class ShoesInBox(Task):
    """See the module's docstring.

    Args:
      layout: where episodes start.
      physics: constants.
      detector: how boxes are seen; perfectly by default.
    """

    name = "shoes_in_box"
    objects = OBJECTS
    event_names = ("lid_open", "shoe_1_placed", "shoe_2_placed")
    episode_length = 480
    frame_rate = 1 / CONTROL_DT
    pretraining = PretrainHyper(rearranged=0.0, robot_messages=0.0)
    action_size = 5
    observation_size = 46

    def __init__(self, layout: Layout | None = None, physics: Physics | None = None, detector: Detector | None = None):
        self.layout = layout or Layout()
        self.physics = physics or Physics()
        self.detector = detector or Detector()
        self.mj_model = build_model(self.physics)
        self._model = mjx.put_model(self.mj_model)
        self._template = mjx.make_data(self.mj_model)
        self._box_body = mujoco.mj_name2id(self.mj_model, mujoco.mjtObj.mjOBJ_BODY, "box")
        self._pads = self._geoms("left_pad", "right_pad")
        self._uppers = self._geoms(*(f"{shoe}_upper" for shoe in SHOE_NAMES))

    def _geoms(self, *names: str) -> np.ndarray:
        return np.array([mujoco.mj_name2id(self.mj_model, mujoco.mjtObj.mjOBJ_GEOM, name) for name in names])

    def reset(self, rng: jax.Array) -> State:
        layout_key, frame_key = jax.random.split(rng)
        qpos, box = self.layout.sample(layout_key)
        still = jnp.zeros(self.mj_model.nv)
        arm = qpos[:7]
        frame = jax.random.bits(frame_key, dtype=jnp.uint32)
        physics = PhysicsState(qpos, still, still, kinematics.pose(arm), arm, box, jnp.zeros(2, bool), frame)
        zero = jnp.zeros((), jnp.float32)
        return State(physics, observe(physics), zero, zero, {"success": zero, "score": zero}, {})

    def step(self, state: State, action: jax.Array) -> State:
        physics = self.advance(state.pipeline_state, action)
        metrics = {**state.metrics, "success": success(physics).astype(jnp.float32), "score": score(physics)}
        return state.replace(
            pipeline_state=physics, obs=observe(physics), reward=environment_reward(physics), metrics=metrics
        )

    def advance(self, state: PhysicsState, action: jax.Array) -> PhysicsState:
        """One control step of physics under `action` (5,)."""
        action = jnp.clip(action, -1.0, 1.0)
        step = CONTROL_DT * jnp.append(SPEED * action[:3], TURN_RATE * action[3])
        here = kinematics.pose(state.qpos[:7])
        place = jnp.clip((state.target + step)[:3], WORKSPACE[0], WORKSPACE[1])
        target = jnp.append(here[:3] + jnp.clip(place - here[:3], -LEAD, LEAD), state.target[3] + step[3])
        arm = kinematics.approach(state.arm, target)
        opening = CLOSED + (FINGER_OPEN - CLOSED) * (action[4] + 1) / 2
        ctrl = jnp.concatenate([arm, jnp.stack([opening, opening])])
        half = state.box[2] / 2
        # A model of its own per environment: mjx gives children of mocap bodies wrong poses.
        model = self._model.replace(
            body_pos=self._model.body_pos.at[self._box_body, :2].set(state.box[:2]),
            body_quat=self._model.body_quat.at[self._box_body].set(
                jnp.stack([jnp.cos(half), 0 * half, 0 * half, jnp.sin(half)])
            ),
        )

        def substep(carry: tuple, _: None) -> tuple:
            qpos, qvel, warmstart, _ = carry
            data = self._template.replace(qpos=qpos, qvel=qvel, qacc_warmstart=warmstart, ctrl=ctrl)
            data = mjx.step(model, data)
            return (data.qpos, data.qvel, data.qacc_warmstart, self._touched(data)), None

        carry = (state.qpos, state.qvel, state.warmstart, state.touched)
        (qpos, qvel, warmstart, touched), _ = jax.lax.scan(substep, carry, None, length=self.physics.substeps)
        return PhysicsState(qpos, qvel, warmstart, target, arm, state.box, touched, state.frame + 1)

    def _touched(self, data: mjx.Data) -> jax.Array:
        """Which shoes a pad touches: (2,) bool."""
        contact = data._impl.contact
        pad = jnp.isin(contact.geom, self._pads).any(axis=1) & (contact.dist < 0)
        return jnp.stack([jnp.any(pad & (contact.geom == upper).any(axis=1)) for upper in self._uppers])

    def boxes(self, state: State) -> tuple[jax.Array, jax.Array]:
        return self.look(state.pipeline_state)

    def look(self, physics: PhysicsState) -> tuple[jax.Array, jax.Array]:
        """Boxes (N, 4) and mask (N,) of a physics state, as the detector sees it."""
        boxes, depths = geometry.boxes(physics.qpos, physics.box), geometry.depths(physics.qpos, physics.box)
        return self.detector.see(jax.random.key(physics.frame), boxes, depths, ~OBJECTS.fixture_flags())

    def events(self, state: State) -> jax.Array:
        return events(state.pipeline_state)

    def training(self) -> "ShoesInBox":
        return self

    def demonstrate(
        self, key: jax.Array, successes: int, failures: int = 0, picture_size: int | None = None
    ) -> Demonstrations:
        from tasks.shoes_in_box.expert import demonstrate

        return demonstrate(self, key, successes, failures, picture_size)

    def landscape(self, key: jax.Array) -> Landscape:
        from tasks.shoes_in_box.scenes import landscape

        return landscape(key)

    def draw_episode(
        self, states: Any, boxes: np.ndarray, mask: np.ndarray, active: np.ndarray, rewards: np.ndarray, label: str
    ) -> np.ndarray:
        from tasks.shoes_in_box.render import episode_frames

        return episode_frames(states.qpos, states.box, boxes, active, rewards, label)


def shoes(qpos: jax.Array) -> jax.Array:
    """Free joints (2, 7) of both shoes in `qpos` (24,)."""
    return qpos[10:].reshape(2, 7)


def lid_is_open(state: PhysicsState) -> jax.Array:
    """Whether the lid leans open, near its stop: () bool."""
    return state.qpos[9] > LID_COUNTS_AS_OPEN


def shoes_inside(state: PhysicsState) -> jax.Array:
    """Whether each shoe's centre is inside the box: (2,) bool."""
    return jax.vmap(lambda shoe: geometry.inside_box(state.box, shoe[:3]))(shoes(state.qpos))


def success(state: PhysicsState) -> jax.Array:
    """Both shoes inside and none of them touched: () bool."""
    return shoes_inside(state).all() & ~state.touched.any()


def score(state: PhysicsState) -> jax.Array:
    """Share of lid opened and shoes inside: a third for each; ()."""
    return (lid_is_open(state) + shoes_inside(state).sum()) / 3


def events(state: PhysicsState) -> jax.Array:
    """Whether each of `ShoesInBox.event_names` counts as reached, a shoe once it is let go: (3,) bool."""
    return jnp.append(lid_is_open(state), shoes_inside(state) & ~state.touched)


def environment_reward(state: PhysicsState) -> jax.Array:
    """Score, the lid's angle, the way of shoes to the box and of the gripper to what is to be moved next; ()."""
    here = kinematics.pose(state.qpos[:7])[:3]
    inside, opened = shoes_inside(state), lid_is_open(state)
    places = shoes(state.qpos)[:, :3]
    to_box = jnp.where(inside, 0.0, jnp.linalg.norm(places[:, :2] - state.box[:2], axis=-1))
    to_shoe = jnp.min(jnp.where(inside, 1.0, jnp.linalg.norm(places - here, axis=-1)))
    to_bar = jnp.linalg.norm(geometry.bar(state.box, state.qpos[9]) - here)
    reach = jnp.where(opened, jnp.where(inside.all(), 0.0, to_shoe), 1.0 + to_bar)
    return score(state) + state.qpos[9] / LID_OPEN - to_box.sum() - 0.5 * reach - 1.0


def observe(state: PhysicsState) -> jax.Array:
    """The observation described in the module's docstring: (46,)."""
    frame = geometry.box_pose(state.box)
    here = kinematics.pose(state.qpos[:7])

    def there(point: jax.Array) -> jax.Array:
        return (point - frame.position) @ frame.rotation

    def seen(shoe: jax.Array, inside: jax.Array, touched: jax.Array) -> jax.Array:
        twice = 2 * (geometry.shoe_yaw(shoe) - state.box[2])
        lying = geometry.shoe_pose(shoe).rotation[2, 2]
        flags = jnp.stack([jnp.sin(twice), jnp.cos(twice), lying, inside, touched])
        return jnp.concatenate([there(shoe[:3]), frame.rotation.T @ (shoe[:3] - here[:3]), flags])

    yaw = here[3] - state.box[2]
    bar = geometry.bar(state.box, state.qpos[9])
    return jnp.concatenate(
        [
            there(here[:3]),
            jnp.stack([jnp.sin(yaw), jnp.cos(yaw)]),
            state.qpos[7:9] / FINGER_OPEN,
            state.qpos[:7],
            state.box[:2],
            jnp.stack([jnp.sin(state.box[2]), jnp.cos(state.box[2]), state.qpos[9] / LID_OPEN, state.qvel[9]]),
            frame.rotation.T @ (bar - here[:3]),
            jax.vmap(seen)(shoes(state.qpos), shoes_inside(state).astype(float), state.touched.astype(float)).ravel(),
            lid_is_open(state).astype(jnp.float32)[None],
        ]
    )
