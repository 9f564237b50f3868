"""Shoes in Box as a Brax environment on MJX: open the box by the bar of its lid, put both shoes in, let go.

Action (5,) in [-1, 1]: velocity of the gripper along x, y, z (0.4 m/s), its turn about the vertical (2 rad/s), and
the opening of the fingers (closed at -1, 8 cm at 1). The gripper points down; a step of differential inverse kinematics
turns its pose into joint targets, 20 times a second.

`observation.py` describes the observation.

Success: the centres of both shoes are inside the box, and no pad touches a shoe.
"""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from brax.envs.base import Env, State
from mujoco import mjx

from tasks.detector_noise import DetectorNoise
from tasks.shoes_in_box import geometry, kinematics, observation
from tasks.shoes_in_box.layouts import Layout
from tasks.shoes_in_box.model import CONTROL_DT, FINGER_OPEN, SHOE_NAMES, Physics, build_model
from tasks.shoes_in_box.objects import OBJECTS
from tasks.shoes_in_box.observation import observe
from tasks.shoes_in_box.reward import environment_reward
from tasks.shoes_in_box.state import EVENT_NAMES, PhysicsState, events, score, success

SPEED, TURN_RATE = 0.4, 2.0
# Bounds of the gripper's target, and its largest lead over the gripper per axis, in metres.
WORKSPACE = np.array([[0.15, -0.5, 0.03], [0.72, 0.5, 0.45]], np.float32)
LEAD = 0.04
# Commanded opening of closed fingers; below 0, so that they press on what they hold.
CLOSED = -0.02


class ShoesInBoxEnv(Env):
    """Physics, observation and reward; see the module's docstring.

    Args:
      layout: distribution of starts.
      physics: constants.
      detector_noise: noise on boxes and mask; default: none.
    """

    name = "shoes_in_box"
    objects = OBJECTS
    event_names = EVENT_NAMES
    episode_length = 480
    frame_rate = 1 / CONTROL_DT
    action_size = 5
    observation_size = observation.SIZE
    backend = "mjx"

    def __init__(
        self,
        layout: Layout | None = None,
        physics: Physics | None = None,
        detector_noise: DetectorNoise | None = None,
    ):
        self.layout = layout or Layout()
        self.physics = physics or Physics()
        self.detector_noise = detector_noise or DetectorNoise()
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
        # Every environment has its own model, because MJX gives children of mocap bodies wrong poses.
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
        """Boxes (N, 4) and mask (N,) of a physics state, with detector noise."""
        boxes, depths = geometry.boxes(physics.qpos, physics.box), geometry.depths(physics.qpos, physics.box)
        return self.detector_noise.see(jax.random.key(physics.frame), boxes, depths, ~OBJECTS.fixture_flags())

    def events(self, state: State) -> jax.Array:
        return events(state.pipeline_state)
