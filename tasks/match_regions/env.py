"""Match Regions as a Brax environment on MJX: put the green star and the green square into the green region.

Action (3,) in [-1, 1]: speed (0.8 units/s forwards, 0.6 backwards), turn (2.5 rad/s, counter-clockwise positive) and
gripper (closed below 0, open from 0 on): MAGICAL's controls with continuous speed and turn. What a policy sees is
described in `observation.py`; other blocks, regions and forces in `variants.py`.
"""

import copy
import dataclasses
from typing import Any, Literal

import jax
import jax.numpy as jnp
import numpy as np
from brax.envs.base import State
from mujoco import mjx

from graphrl_jax.demonstrations import Demonstrations
from graphrl_jax.detection import Detector
from graphrl_jax.graph import safe_norm
from graphrl_jax.landscape import Landscape
from graphrl_jax.task import Task
from tasks.match_regions import geometry, layouts, magical, observation, raster
from tasks.match_regions.model import (
    CONTROL_DT,
    DRIVEN_MASS,
    FINGER_OPEN,
    ROBOT_RADIUS,
    Physics,
    build_model,
)
from tasks.match_regions.objects import OBJECTS, class_ids, variant_objects
from tasks.match_regions.observation import TURN_RATE, observe
from tasks.match_regions.reward import Reward, environment_reward
from tasks.match_regions.state import PhysicsState, boxes, placed_targets, score

FORWARD_SPEED, BACKWARD_SPEED, FINGER_RATE = 4 * ROBOT_RADIUS, 3 * ROBOT_RADIUS, 1.0
# MAGICAL's fingers approach their angle at ten times the error per second.
_FINGER_GAIN = 10.0
# Of blocks that are not there: they lie beside the arena.
_NO_LIMIT = 100.0


class MatchRegions(Task):
    """See the module's docstring.

    Args:
      layout: where episodes start (see `layouts.py`).
      physics, reward: constants.
      targets_in_order: observe the target to see to first; otherwise the first always comes first.
      varied: share of training episodes that start part of the way to the goal (see `layouts.Training`).
      control: `discrete` takes MAGICAL's actions by number, () int, instead of ours (see `magical.action`): for replays
        and planners; policies and the expert act continuously.

    Raises:
      ValueError: another control.
    """

    name = "match_regions"
    episode_length = 120
    frame_rate = 1 / CONTROL_DT
    action_size = 3
    observation_size = observation.SIZE

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
        self.objects = OBJECTS if self.layout.fixed else variant_objects(self.layout.blocks)
        targets = self.objects.names[2 : 2 + layouts.NUM_TARGETS]
        self.event_names = tuple(f"{name}_placed" for name in (*targets, "both"))
        self.mj_model = build_model(self.physics, self.layout.blocks)
        self._model = mjx.put_model(self.mj_model)
        self._template = mjx.make_data(self.mj_model)

    def reset(self, rng: jax.Array) -> State:
        qpos, moved, homes, scene = self.layout.sample(rng)
        distance = jnp.linalg.norm(homes - geometry.region_centre(scene.region), axis=-1)
        distance = jnp.where(scene.present[: layouts.NUM_TARGETS], distance, 0.0)
        zeros, zero = jnp.zeros_like(qpos), jnp.zeros((), jnp.float32)
        physics = PhysicsState(qpos, zeros, zeros, distance, scene)
        metrics = {"success": zero, "score": zero}
        # A target that starts in its place has been moved there.
        placed = placed_targets(qpos, scene) & scene.present[: layouts.NUM_TARGETS]
        moved = moved.at[: layouts.NUM_TARGETS].set(moved[: layouts.NUM_TARGETS] | placed)
        info = {"active": jnp.zeros(self.objects.num_slots, bool).at[2 : 2 + self.layout.blocks].set(moved)}
        if not self.layout.fixed:
            info["class_ids"] = class_ids(scene)
        return State(physics, observe(physics, self.targets_in_order), zero, zero, metrics, info)

    def step(self, state: State, action: jax.Array) -> State:
        physics = self.advance(state.pipeline_state, action)
        value = score(physics.qpos, physics.scene)
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
        model = self._model_of(state.scene)
        drive_force = self.physics.drive_force * (1.0 if self.layout.fixed else state.scene.strengths[0])

        def substep(carry: tuple, _: None) -> tuple:
            qpos, qvel, warmstart = carry
            finger_rates = jnp.clip((finger_targets - qpos[3:5]) * _FINGER_GAIN, -FINGER_RATE, FINGER_RATE)
            velocity = self._drive(speed * geometry.heading(qpos[2]), qvel[:2], drive_force)
            ctrl = jnp.concatenate([velocity, action[1:2] * TURN_RATE, finger_rates])
            data = self._template.replace(qpos=qpos, qvel=qvel, qacc_warmstart=warmstart, ctrl=ctrl)
            data = mjx.step(model, data)
            qpos = data.qpos - self.physics.lag * self.physics.timestep * (data.qvel - qvel)
            return (qpos, data.qvel, data.qacc_warmstart), None

        carry = (state.qpos, state.qvel, state.warmstart)
        (qpos, qvel, warmstart), _ = jax.lax.scan(substep, carry, None, length=self.physics.substeps)
        return state._replace(qpos=qpos, qvel=qvel, warmstart=warmstart)

    def _model_of(self, scene: layouts.Scene) -> mjx.Model:
        """The model of one episode: its forces, and no walls for blocks that are not there."""
        if self.layout.fixed:
            return self._model
        drive, turn, finger, force, torque = scene.strengths
        actuators = jnp.stack([drive, drive, turn, finger, finger])[:, None]
        frictions = jnp.concatenate([jnp.ones(5), jnp.tile(jnp.stack([force, force, torque]), self.layout.blocks)])
        away = jnp.concatenate([jnp.zeros(5, bool), jnp.repeat(~scene.present, 3)])
        return self._model.replace(
            actuator_forcerange=self._model.actuator_forcerange * actuators,
            dof_frictionloss=self._model.dof_frictionloss * frictions,
            jnt_range=jnp.where(away[:, None], jnp.array([-_NO_LIMIT, _NO_LIMIT]), self._model.jnt_range),
        )

    def _drive(self, wanted: jax.Array, velocity: jax.Array, force: jax.Array | float) -> jax.Array:
        """Velocity (2,) that the servos of both axes are told: a servo gains what it lacks within one sub-step, unless
        its force is limited. Here that of both together is, as MAGICAL does it.
        """
        change = wanted - velocity
        most = force / DRIVEN_MASS * self.physics.timestep
        return velocity + change * jnp.minimum(1.0, most / jnp.maximum(safe_norm(change), 1e-6))

    def boxes(self, state: State) -> tuple[jax.Array, jax.Array]:
        return self.scene_boxes(state.pipeline_state.qpos, state.pipeline_state.scene)

    def scene_boxes(self, qpos: jax.Array, scene: layouts.Scene) -> tuple[jax.Array, jax.Array]:
        """Image-plane boxes (N, 4) and mask (N,) of the scene at `qpos` (5 + 3M,)."""
        found, mask = boxes(qpos, scene)
        spare = self.objects.num_slots - mask.shape[0]
        return jnp.pad(found, ((0, spare), (0, 0))), jnp.pad(mask, (0, spare))

    def events(self, state: State) -> jax.Array:
        placed = placed_targets(state.pipeline_state.qpos, state.pipeline_state.scene)
        return jnp.append(placed, placed.all())

    def training(self) -> "MatchRegions":
        if self.control == "discrete":
            raise ValueError("policies act continuously; allowed: control 'continuous'")
        return self._changed(layout=layouts.Training(self.layout, self.varied))

    def with_reward(self, **changes: float) -> "MatchRegions":
        """The same task with some constants of its reward changed."""
        return self._changed(reward=dataclasses.replace(self.reward, **changes))

    def with_layout(self, layout: layouts.Layout) -> "MatchRegions":
        """The same task with other starts, drawn by a layout of as many blocks; its leaves may be traced."""
        return self._changed(layout=layout)

    def _changed(self, **changes: Any) -> "MatchRegions":
        if all(getattr(self, name) is value for name, value in changes.items()):
            return self  # and what was compiled for it serves on
        other = copy.copy(self)
        vars(other).update(changes)
        return other

    def picture(self, physics: PhysicsState, size: int) -> jax.Array:
        return raster.picture(physics.qpos, physics.scene, size)

    def picture_detector(self) -> Detector | None:
        # It tells the Demo scene's objects apart, by that table's classes.
        return magical.detector() if self.layout.fixed else None

    def demonstrate(
        self, key: jax.Array, successes: int, failures: int = 0, picture_size: int | None = None
    ) -> Demonstrations:
        from tasks.match_regions.expert import demonstrate

        return demonstrate(self._changed(control="continuous"), key, successes, failures, picture_size)

    def draw_episode(
        self, states: Any, boxes: np.ndarray, mask: np.ndarray, active: np.ndarray, rewards: np.ndarray, label: str
    ) -> np.ndarray:
        from tasks.match_regions.render import episode_frames

        return episode_frames(states.qpos, states.scene, boxes, mask, active, rewards, size=320, label=label)

    def landscape(self, key: jax.Array) -> Landscape:
        from tasks.match_regions.scenes import landscape

        return landscape(self, key)
