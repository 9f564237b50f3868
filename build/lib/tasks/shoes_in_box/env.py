"""Shoes in Box as a Brax environment: open the box by the bar of its lid, put both shoes in, let go.

Action (5,) in [-1, 1]: velocity of the gripper along x, y, z (0.4 m/s), its turn about the vertical (2 rad/s), and
the fingers: up to -0.5 they close, from 0.5 on they open, by 4 cm at 0.5 and by 8 cm at 1; in between they keep their
command. The gripper points down. A step of differential inverse kinematics turns its pose into joint targets, 20 times
a second.

`observation.py` describes the observation.

Success: the centres of both shoes are inside the box, and no pad touches a shoe.
"""

from typing import Any

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from brax.envs.base import Env, State

from tasks.detector_noise import DetectorNoise
from tasks.engine import Dynamics, Fields, make_engine
from tasks.shoes_in_box import geometry, kinematics, observation
from tasks.shoes_in_box.layouts import Layout
from tasks.shoes_in_box.model import CONTROL_DT, FINGER_OPEN, Physics, build_model
from tasks.shoes_in_box.objects import OBJECTS
from tasks.shoes_in_box.observation import observe
from tasks.shoes_in_box.reward import environment_reward
from tasks.shoes_in_box.starts import Curriculum, Mixture, Start, Starts, adapt, begin, draw
from tasks.shoes_in_box.state import EVENT_NAMES, PhysicsState, events, score, success

SPEED, TURN_RATE = 0.4, 2.0
# Bounds of the gripper's target, and its largest lead over the gripper per axis, in metres.
WORKSPACE = np.array([[0.15, -0.5, 0.03], [0.72, 0.5, 0.45]], np.float32)
LEAD = 0.04
# Commanded position of each finger when closed, below 0, so that they press on what they hold; and the least open one.
CLOSED, LEAST_OPEN = -0.02, 0.02


def finger_target(grip: jax.Array, before: jax.Array) -> jax.Array:
    """Commanded position of each finger for the last entry of an action and the command `before`, metres; ().

    In between the command stays; otherwise a policy that still explores would drop what it holds.
    """
    opened = LEAST_OPEN + (FINGER_OPEN - LEAST_OPEN) * (2 * grip - 1)
    return jnp.where(grip >= 0.5, opened, jnp.where(grip <= -0.5, CLOSED, before))


def grip_of(finger: jax.Array) -> jax.Array:
    """The last entry of an action for a commanded position of each finger, the inverse of `finger_target`."""
    opened = (1 + (finger - LEAST_OPEN) / (FINGER_OPEN - LEAST_OPEN)) / 2
    return jnp.where(finger < LEAST_OPEN, -1.0, jnp.clip(opened, 0.5, 1.0))


class ShoesInBoxEnv(Env):
    """Physics, observation and reward; see the module's docstring.

    Args:
      layout: distribution of starts.
      physics: constants.
      detector_noise: noise on boxes and mask; default: none.
      mixture: starts of training episodes.
      engine: name of the physics engine, see `tasks.engine`; default: the device's.

    Raises:
      ValueError: the engine is unknown or cannot run here.
    """

    name = "shoes_in_box"
    objects = OBJECTS
    event_names = EVENT_NAMES
    episode_length = 480
    frame_rate = 1 / CONTROL_DT
    decision_steps = 4
    # Straight up, with the fingers as they are.
    retreat_action = (0.0, 0.0, 1.0, 0.0, 0.0)
    action_size = 5
    observation_size = observation.SIZE
    backend = "mjx"

    def __init__(
        self,
        layout: Layout | None = None,
        physics: Physics | None = None,
        detector_noise: DetectorNoise | None = None,
        mixture: Mixture | None = None,
        engine: str | None = None,
    ):
        self.layout = layout or Layout()
        self.physics = physics or Physics()
        self.detector_noise = detector_noise or DetectorNoise()
        self.mixture = mixture or Mixture()
        self.starts: Starts | None = None
        self.mj_model = build_model(self.physics)
        self.engine = make_engine(engine, self.mj_model)
        self._box_body = mujoco.mj_name2id(self.mj_model, mujoco.mjtObj.mjOBJ_BODY, "box")

    def reset(self, rng: jax.Array) -> State:
        return self._begin(rng, None if self.starts is None else begin(self.mixture))

    def restart(self, rng: jax.Array, last: State) -> State:
        """The start of the next training episode; see `starts.Curriculum`."""
        if self.starts is None:
            return self.reset(rng)
        return self._begin(rng, adapt(last.info["curriculum"], self.mixture, last.pipeline_state))

    def _begin(self, rng: jax.Array, curriculum: Curriculum | None) -> State:
        layout_key, frame_key, start_key = jax.random.split(rng, 3)
        qpos, box = self.layout.sample(layout_key)
        still = jnp.zeros(self.mj_model.nv)
        arm = qpos[:7]
        frame = jax.random.bits(frame_key, dtype=jnp.uint32)
        finger, touched = jnp.asarray(FINGER_OPEN), jnp.zeros(2, bool)
        physics = PhysicsState(qpos, still, still, kinematics.pose(arm), arm, finger, box, touched, frame)
        start = Start(physics, jnp.zeros(OBJECTS.num_slots, bool))
        zero = jnp.zeros((), jnp.float32)
        info = {}
        if self.starts is not None and curriculum is not None:
            start, curriculum = draw(start_key, self.mixture, self.starts, curriculum, start)
            info = {"curriculum": curriculum}
        info["active"] = start.active
        metrics = {"success": zero, "score": zero, **_lead(info)}
        return State(start.physics, observe(start.physics), zero, zero, metrics, info)

    def step(self, state: State, action: jax.Array) -> State:
        physics = self.advance(state.pipeline_state, action)
        reached = {"success": success(physics).astype(jnp.float32), "score": score(physics)}
        metrics = {**state.metrics, **reached, **_lead(state.info)}
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
        finger = finger_target(action[4], state.finger)
        ctrl = jnp.concatenate([arm, jnp.stack([finger, finger])])
        dynamics = Dynamics(state.qpos, state.qvel, state.warmstart)
        after, readings = self.engine.step(dynamics, ctrl, self.fields(state), self.physics.substeps)
        touched = (readings.reshape(2, 2) > 0).any(axis=1)
        return PhysicsState(*after, target, arm, finger, state.box, touched, state.frame + 1)

    def fields(self, state: PhysicsState) -> Fields:
        """Fields of the model in one episode: the pose of the box; MJX gives children of mocap bodies wrong poses."""
        box = state.box
        half, zero = box[2] / 2, jnp.zeros(())
        places = jnp.asarray(self.mj_model.body_pos, jnp.float32)
        turns = jnp.asarray(self.mj_model.body_quat, jnp.float32)
        turn = jnp.stack([jnp.cos(half), zero, zero, jnp.sin(half)])
        return {
            "body_pos": places.at[self._box_body, :2].set(box[:2]),
            "body_quat": turns.at[self._box_body].set(turn),
        }

    def boxes(self, state: State) -> tuple[jax.Array, jax.Array]:
        return self.look(state.pipeline_state)

    def look(self, physics: PhysicsState) -> tuple[jax.Array, jax.Array]:
        """Boxes (N, 4) and mask (N,) of a physics state, with detector noise."""
        boxes, depths = geometry.boxes(physics.qpos, physics.box), geometry.depths(physics.qpos, physics.box)
        return self.detector_noise.see(jax.random.key(physics.frame), boxes, depths, ~OBJECTS.fixture_flags())

    def events(self, state: State) -> jax.Array:
        return events(state.pipeline_state)


def _lead(info: dict[str, Any]) -> dict[str, jax.Array]:
    """The metric `lead` of a training episode: the mean of the curriculum's leads."""
    return {"lead": jnp.mean(info["curriculum"].leads)} if "curriculum" in info else {}
