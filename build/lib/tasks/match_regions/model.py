"""The planar MuJoCo scene of Match Regions, in MAGICAL's arena units (one unit is half the arena's side).

Everything moves in the plane z = 0 and is seen from above. Blocks collide as discs of their nominal size, so that
every contact between bodies is a sphere-sphere or sphere-capsule pair; drawn outlines (`geometry.py`) give the boxes.
Sub-steps, solver and contact limits were chosen with `benchmarks/physics_settings.py`. `benchmarks/magical_fidelity.py`
measures their effect on recorded human actions.
"""

import math
from dataclasses import dataclass

import mujoco

ARENA_HALF = 1.0
ROBOT_RADIUS = 0.2
ROBOT_MASS = 1.0
FINGER_MASS = 1.0 / 8.0
DRIVEN_MASS = ROBOT_MASS + 2 * FINGER_MASS
FINGER_HINGE = (0.45 * ROBOT_RADIUS, 0.1 * ROBOT_RADIUS)
FINGER_UPPER = 1.1 * ROBOT_RADIUS
FINGER_LOWER = 0.7 * ROBOT_RADIUS
FINGER_BEND = math.pi / 8
FINGER_OPEN = math.pi / 8
FINGER_HALF_THICKNESS = 0.125 * ROBOT_RADIUS
BLOCK_SIZE = 0.12
BLOCK_MASS = 0.5
BLOCK_REACH = ARENA_HALF - BLOCK_SIZE
CONTROL_DT = 0.125
"""Seconds per control step: MAGICAL runs at 8 Hz."""
MAGICAL_SUBSTEPS = 10
# Dry friction acts per axis; with this factor its mean over all directions of motion is MAGICAL's limit.
_FRICTION_PER_AXIS = math.pi / 4
# Inertia of a finger about its hinge, which is also its centre of mass in MAGICAL.
_FINGER_INERTIA = 0.005


@dataclass(frozen=True)
class Physics:
    """Simulation settings (static: they shape the compiled program).

    Forces are in arena units. As in MAGICAL, they limit the motors of joints and the dry friction under blocks.
    """

    substeps: int = 3
    iterations: int = 1
    ls_iterations: int = 4
    max_contact_points: int = 6
    drive_force: float = 3.0
    turn_torque: float = 1.0
    finger_torque: float = 4.0
    block_friction_force: float = 1.5
    block_friction_torque: float = 0.1
    block_damping: float = 1.0
    finger_friction: float = 2.5
    finger_armature: float = 0.1
    contact_time_constant: float = 2.0

    @property
    def timestep(self) -> float:
        """Seconds per sub-step."""
        return CONTROL_DT / self.substeps

    @property
    def lag(self) -> float:
        """Share of a sub-step by which positions lag behind velocities.

        MuJoCo moves bodies by their new velocity, which runs half a sub-step ahead; MAGICAL's engine moves them by the
        old one, half of its own sub-step behind.
        """
        return 0.5 + 0.5 * self.substeps / MAGICAL_SUBSTEPS


FAITHFUL = Physics(substeps=6, iterations=4, ls_iterations=8, max_contact_points=10, block_damping=0.0)
"""Settings closer to MAGICAL, and slower; see `benchmarks/magical_fidelity.py`."""


def _slide_joints(name: str, reach: float, frictionloss: float = 0.0, damping: float = 0.0) -> str:
    return "".join(
        f'<joint name="{name}_{axis}" type="slide" axis="{vector}" limited="true" range="{-reach} {reach}"'
        f' frictionloss="{frictionloss}" damping="{damping}"/>'
        for axis, vector in (("x", "1 0 0"), ("y", "0 1 0"))
    )


def _finger(side: str, sign: int, physics: Physics) -> str:
    """One finger: an upper and a lower capsule, the lower bent inwards, hinged at the robot's front."""
    hinge_x, hinge_y = sign * FINGER_HINGE[0], FINGER_HINGE[1]
    tip_x = -sign * FINGER_LOWER * math.sin(FINGER_BEND)
    tip_y = FINGER_UPPER + FINGER_LOWER * math.cos(FINGER_BEND)
    low, high = sorted((0.0, -sign * FINGER_OPEN))
    return f"""
    <body name="{side}_finger" pos="{hinge_x} {hinge_y} 0">
      <joint name="{side}_finger" type="hinge" axis="0 0 1" limited="true" range="{low} {high}"
             armature="{physics.finger_armature}"/>
      <inertial pos="0 0 0" mass="{FINGER_MASS}" diaginertia="{_FINGER_INERTIA} {_FINGER_INERTIA} {_FINGER_INERTIA}"/>
      <geom name="{side}_upper" type="capsule" size="{FINGER_HALF_THICKNESS}" fromto="0 0 0 0 {FINGER_UPPER} 0"/>
      <geom name="{side}_lower" type="capsule" size="{FINGER_HALF_THICKNESS}"
            fromto="0 {FINGER_UPPER} 0 {tip_x} {tip_y} 0"/>
      <geom name="{side}_tip" type="sphere" size="{FINGER_HALF_THICKNESS}" pos="{tip_x} {tip_y} 0"/>
    </body>"""


def _block_names(blocks: int) -> list[str]:
    return [f"block_{index}" for index in range(blocks)]


def _block(name: str, physics: Physics) -> str:
    # Damping stops the creep that one solver iteration leaves in the dry friction.
    friction = physics.block_friction_force * _FRICTION_PER_AXIS
    inertia = 0.5 * BLOCK_MASS * BLOCK_SIZE**2
    return f"""
  <body name="{name}">
    {_slide_joints(name, BLOCK_REACH, friction, physics.block_damping)}
    <joint name="{name}_theta" type="hinge" axis="0 0 1" frictionloss="{physics.block_friction_torque}"/>
    <inertial pos="0 0 0" mass="{BLOCK_MASS}" diaginertia="{inertia} {inertia} {inertia}"/>
    <geom name="{name}" type="sphere" size="{BLOCK_SIZE}"/>
  </body>"""


def _contact_pairs(physics: Physics, names: list[str]) -> str:
    fingers = [f"{side}_{part}" for side in ("left", "right") for part in ("upper", "lower")]
    walls = ("west", "east", "south", "north")
    grips = [(finger, block) for finger in fingers for block in names]
    smooth = [("robot", block) for block in names]
    smooth += [(a, b) for i, a in enumerate(names) for b in names[i + 1 :]]
    smooth += [(f"{side}_tip", wall) for side in ("left", "right") for wall in walls]
    mu = physics.finger_friction
    return "".join(
        [f'<pair geom1="{a}" geom2="{b}" condim="3" friction="{mu} {mu} 0 0 0"/>' for a, b in grips]
        + [f'<pair geom1="{a}" geom2="{b}" condim="1"/>' for a, b in smooth]
    )


def _walls() -> str:
    frames = (("west", -1, 0, "1 0 0"), ("east", 1, 0, "-1 0 0"), ("south", 0, -1, "0 1 0"), ("north", 0, 1, "0 -1 0"))
    return "".join(
        f'<geom name="{name}" type="plane" size="1 1 1" pos="{x} {y} 0" zaxis="{normal}"/>'
        for name, x, y, normal in frames
    )


def scene_xml(physics: Physics, blocks: int) -> str:
    """MJCF of the scene; joint order: robot x, y, theta, left finger, right finger, then x, y, theta per block."""
    names = _block_names(blocks)
    timestep = physics.timestep
    inertia = 0.5 * ROBOT_MASS * ROBOT_RADIUS**2
    total_inertia = inertia + 2 * (_FINGER_INERTIA + FINGER_MASS * (FINGER_HINGE[0] ** 2 + FINGER_HINGE[1] ** 2))
    finger_inertia = _FINGER_INERTIA + physics.finger_armature
    # With these gains, velocity servos reach the commanded speed within one sub-step, up to the motor's limit.
    drive, turn, grip = DRIVEN_MASS / timestep, total_inertia / timestep, finger_inertia / timestep

    def servo(joint: str, gain: float, limit: float) -> str:
        return f'<velocity joint="{joint}" kv="{gain}" forcelimited="true" forcerange="{-limit} {limit}"/>'

    return f"""
<mujoco model="match_regions">
  <compiler angle="radian" autolimits="true"/>
  <option timestep="{timestep}" gravity="0 0 0" integrator="Euler" solver="Newton" cone="pyramidal"
          iterations="{physics.iterations}" ls_iterations="{physics.ls_iterations}">
    <flag eulerdamp="disable" refsafe="disable"/>
  </option>
  <custom><numeric name="max_contact_points" data="{physics.max_contact_points}"/></custom>
  <default>
    <geom contype="0" conaffinity="0"/>
    <joint solreflimit="{physics.contact_time_constant * timestep} 1" solreffriction="{2 * timestep} 1"/>
    <pair solref="{physics.contact_time_constant * timestep} 1"/>
  </default>
  <worldbody>
    {_walls()}
    <body name="robot">
      {_slide_joints("robot", ARENA_HALF - ROBOT_RADIUS)}
      <joint name="robot_theta" type="hinge" axis="0 0 1"/>
      <inertial pos="0 0 0" mass="{ROBOT_MASS}" diaginertia="{inertia} {inertia} {inertia}"/>
      <geom name="robot" type="sphere" size="{ROBOT_RADIUS}"/>
      {_finger("left", -1, physics)}
      {_finger("right", 1, physics)}
    </body>
    {"".join(_block(name, physics) for name in names)}
  </worldbody>
  <contact>{_contact_pairs(physics, names)}</contact>
  <actuator>
    {servo("robot_x", drive, physics.drive_force)}
    {servo("robot_y", drive, physics.drive_force)}
    {servo("robot_theta", turn, physics.turn_torque)}
    {servo("left_finger", grip, physics.finger_torque)}
    {servo("right_finger", grip, physics.finger_torque)}
  </actuator>
</mujoco>"""


def build_model(physics: Physics, blocks: int = 5) -> mujoco.MjModel:
    """The compiled MuJoCo model of the scene, the input of an engine."""
    return mujoco.MjModel.from_xml_string(scene_xml(physics, blocks))
