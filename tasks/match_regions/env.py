"""Match Regions as a Brax environment: put the green star and the green square into the green region.

Action (3,) in [-1, 1]: speed (0.8 units/s forwards, 0.6 backwards), turn (2.5 rad/s, counter-clockwise positive) and
gripper (closed below 0, open from 0 on). These are MAGICAL's controls with continuous speed and turn. `observation.py`
describes the observation, `variants.py` other blocks, regions and forces.
"""

import copy
import dataclasses
from typing import Any, Literal, Self

import jax
import jax.numpy as jnp
from brax.envs.base import Env, State

from graphrl_jax.graph import safe_norm
from tasks.engine import Dynamics, Fields, make_engine
from tasks.match_regions import geometry, layouts, magical, observation
from tasks.match_regions.model import (
    CONTROL_DT,
    DRIVEN_MASS,
    FINGER_OPEN,
    ROBOT_RADIUS,
    Physics,
    build_model,
)
from tasks.match_regions.objects import OBJECTS, class_ids, variant_objects
from tasks.match_regions.observation import TURN_RATE, observe, observe_blocks
from tasks.match_regions.reward import Reward, environment_reward
from tasks.match_regions.state import PhysicsState, boxes, placed_targets, score

FORWARD_SPEED, BACKWARD_SPEED, FINGER_RATE = 4 * ROBOT_RADIUS, 3 * ROBOT_RADIUS, 1.0
# MAGICAL's fingers approach their angle at ten times the error per second.
_FINGER_GAIN = 10.0
# Joint limit of absent blocks, which lie beside the arena.
_NO_LIMIT = 100.0


class MatchRegionsEnv(Env):
    """Physics, observation and reward; see the module's docstring.

    Args:
      layout: distribution of starts (see `layouts.py`).
      physics, reward: constants.
      targets_in_order: observe the current target first (see `observation.py`), else always the first target.
      varied: share of training episodes that start part of the way to the goal (see `layouts.Training`).
      engine: name of the physics engine, see `tasks.engine`; default: the device's.
      control: `discrete` takes the number of a MAGICAL action, () int (see `magical.action`), for replays and planners;
        policies and the expert use `continuous`.

    Raises:
      ValueError: the control or the engine is unknown, or the engine cannot run here.
    """

    name = "match_regions"
    episode_length = 120
    frame_rate = 1 / CONTROL_DT
    action_size = 3
    observation_size = observation.SIZE
    backend = "mjx"

    def __init__(
        self,
        layout: layouts.Layout | None = None,
        physics: Physics | None = None,
        reward: Reward | None = None,
        targets_in_order: bool = True,
        varied: float = layouts.Training.varied,
        control: Literal["continuous", "discrete"] = "continuous",
        engine: str | None = None,
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
        self.engine = make_engine(engine, self.mj_model)

    def reset(self, rng: jax.Array) -> State:
        qpos, moved, homes, world = self.layout.sample(rng)
        distance = jnp.linalg.norm(homes - geometry.region_centre(world.region)[None], axis=-1)
        distance = jnp.where(world.present[: layouts.NUM_TARGETS], distance, 0.0)
        zeros, zero = jnp.zeros_like(qpos), jnp.zeros((), jnp.float32)
        physics = PhysicsState(qpos, zeros, zeros, distance, world)
        metrics = {"success": zero, "score": zero}
        # A target that starts inside the region counts as moved.
        placed = placed_targets(qpos, world) & world.present[: layouts.NUM_TARGETS]
        moved = moved.at[: layouts.NUM_TARGETS].set(moved[: layouts.NUM_TARGETS] | placed)
        info = {"active": jnp.zeros(self.objects.num_slots, bool).at[2 : 2 + self.layout.blocks].set(moved)}
        if not self.layout.fixed:
            info["class_ids"] = class_ids(world)
        return State(physics, observe(physics, self.targets_in_order), zero, zero, metrics, info)

    def step(self, state: State, action: jax.Array) -> State:
        physics = self.advance(state.pipeline_state, action)
        value = score(physics.qpos, physics.world)
        metrics = {**state.metrics, "success": (value == 1.0).astype(jnp.float32), "score": value}
        reward = environment_reward(physics, self.reward)
        obs = observe(physics, self.targets_in_order)
        return state.replace(pipeline_state=physics, obs=obs, reward=reward, metrics=metrics)

    def advance(self, state: PhysicsState, action: jax.Array) -> PhysicsState:
        """One control step of physics under `action` (3,), or () int if control is discrete."""
        action = magical.action(action) if self.control == "discrete" else jnp.clip(action, -1.0, 1.0)
        speed = action[0] * jnp.where(action[0] > 0, FORWARD_SPEED, BACKWARD_SPEED)
        opening = jnp.where(action[2] < 0, 0.0, FINGER_OPEN)
        finger_targets = jnp.stack([opening, -opening])
        fields = self.fields(state)
        drive_force = self.physics.drive_force * (1.0 if self.layout.fixed else state.world.strengths[0])

        def substep(dynamics: Dynamics, _: None) -> tuple[Dynamics, None]:
            qpos, qvel, _ = dynamics
            finger_rates = jnp.clip((finger_targets - qpos[3:5]) * _FINGER_GAIN, -FINGER_RATE, FINGER_RATE)
            velocity = self._drive(speed * geometry.heading(qpos[2]), qvel[:2], drive_force)
            ctrl = jnp.concatenate([velocity, action[1:2] * TURN_RATE, finger_rates])
            after, _ = self.engine.step(dynamics, ctrl, fields)
            lag = self.physics.lag * self.physics.timestep * (after.qvel - qvel)
            return after._replace(qpos=after.qpos - lag), None

        dynamics = Dynamics(state.qpos, state.qvel, state.warmstart)
        dynamics, _ = jax.lax.scan(substep, dynamics, length=self.physics.substeps)
        return state._replace(**dynamics._asdict())

    def fields(self, state: PhysicsState) -> Fields:
        """Fields of the model in one episode: its forces, and neither walls nor friction for absent blocks.

        Nothing moves these, so friction would change nothing, but C MuJoCo would solve for it.
        """
        if self.layout.fixed:
            return {}
        world = state.world
        drive, turn, finger, force, torque = world.strengths
        actuators = jnp.stack([drive, drive, turn, finger, finger])[:, None]
        frictions = jnp.append(jnp.ones(5), jnp.outer(world.present, jnp.stack([force, force, torque])))
        away = jnp.concatenate([jnp.zeros(5, bool), jnp.repeat(~world.present, 3)])
        model = self.mj_model
        return {
            "actuator_forcerange": jnp.asarray(model.actuator_forcerange, jnp.float32) * actuators,
            "dof_frictionloss": jnp.asarray(model.dof_frictionloss, jnp.float32) * frictions,
            "jnt_range": jnp.where(
                away[:, None], jnp.array([-_NO_LIMIT, _NO_LIMIT]), jnp.asarray(model.jnt_range, jnp.float32)
            ),
        }

    def _drive(self, wanted: jax.Array, velocity: jax.Array, force: jax.Array | float) -> jax.Array:
        """Velocity command (2,) for the servos of both axes. A servo reaches its command within one sub-step, unless
        its force is limited. Here the combined force of both axes is limited, as in MAGICAL.
        """
        change = wanted - velocity
        most = force / DRIVEN_MASS * self.physics.timestep
        return velocity + change * jnp.minimum(1.0, most / jnp.maximum(safe_norm(change), 1e-6))

    def boxes(self, state: State) -> tuple[jax.Array, jax.Array]:
        return self.scene_boxes(state.pipeline_state.qpos, state.pipeline_state.world)

    def scene_boxes(self, qpos: jax.Array, world: layouts.World) -> tuple[jax.Array, jax.Array]:
        """Image-plane boxes (N, 4) and mask (N,) of the scene at `qpos` (5 + 3M,)."""
        found, mask = boxes(qpos, world)
        spare = self.objects.num_slots - mask.shape[0]
        return jnp.pad(found, ((0, spare), (0, 0))), jnp.pad(mask, (0, spare))

    def nodes(self, state: State) -> jax.Array:
        return observe_blocks(state.pipeline_state, state.info["active"][2 : 2 + self.layout.blocks])

    def events(self, state: State) -> jax.Array:
        placed = placed_targets(state.pipeline_state.qpos, state.pipeline_state.world)
        return jnp.append(placed, placed.all())

    def with_reward(self, **changes: float) -> Self:
        """The same task with some constants of its reward changed."""
        return self.changed(reward=dataclasses.replace(self.reward, **changes))

    def with_layout(self, layout: layouts.Layout) -> Self:
        """The same task with another layout of the same number of blocks; its leaves may be traced."""
        return self.changed(layout=layout)

    def changed(self, **changes: Any) -> Self:
        """The same task with other attributes; the same object if nothing changes."""
        if all(getattr(self, name) is value for name, value in changes.items()):
            return self  # so that programs compiled for it are reused
        other = copy.copy(self)
        vars(other).update(changes)
        return other
