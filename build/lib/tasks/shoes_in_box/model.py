"""The MuJoCo scene of Shoes in Box: a Franka Panda, a shoe box with a hinged lid, two shoes. Metres, kilograms, z up.

Kinematics are the manufacturer's, inertials those identified by Gaz et al. ("Dynamic Identification of the Franka Emika
Panda Robot With Retrieval of Feasible Parameters Using Penalty-Based Optimization", 2019); the shapes are primitives.
Collisions are explicit pairs: pads with shoes and the lid's bar, finger tips with table and walls, the palm with the
lid, soles of shoes with the table, and capsules of shoes with walls, lid, table and each other.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import mujoco

CONTROL_DT = 0.05
"""Seconds per control step."""

# The box: inner half sizes along x (towards the hinge) and y (along the hinge), walls, and the lid's bar.
INNER = (0.104, 0.150)
WALL = 0.004
WALL_HEIGHT = 0.08
LID_MASS = 0.15
LID_OPEN = 2.0
"""Angle of the lid at its stop, radians; beyond pi / 2 (upright) it falls open."""
BAR_STANDOFF = 0.045
BAR_RADIUS, BAR_HALF_LENGTH = 0.008, 0.05
HINGE = (INNER[0] + 2 * WALL, 0.0, WALL_HEIGHT + WALL)
BAR_REACH = 2 * (INNER[0] + 2 * WALL) + BAR_STANDOFF
"""Distance from the hinge to the bar."""

SOLE = (0.085, 0.025, 0.010)
UPPER_RADIUS, UPPER_HALF_LENGTH, UPPER_HEIGHT = 0.024, 0.06, 0.028
SHOE_MASS = 0.2
SHOE_NAMES = ("shoe_1", "shoe_2")

# Centre in the finger's frame (y away from the other finger) and half sizes.
PAD_DISTANCE = 0.045
PAD = ((0.0, 0.004, PAD_DISTANCE), (0.016, 0.004, 0.012))
SHAFT = ((0.0, 0.012, 0.018), (0.009, 0.006, 0.020))
TIP_CENTRE, TIP_RADIUS = (0.0, 0.008, PAD_DISTANCE + 0.003), 0.008
FINGER_DISTANCE = 0.0584
TCP_DISTANCE = FINGER_DISTANCE + PAD_DISTANCE
"""Distance from the hand's frame to the point between the pads."""
FINGER_OPEN = 0.04
HAND = (0.02, 0.10, 0.028)
HAND_CENTRE = 0.03

CAMERA = (1.15, -0.75, 1.05)
LOOK_AT = (0.45, 0.0, 0.05)
FIELD_OF_VIEW = 42.0
"""Field of view of the square image, degrees."""

# Joint limits; frame of each link in the previous one (position, rotation about x in quarter turns).
JOINT_RANGES = (
    (-2.8973, 2.8973), (-1.7628, 1.7628), (-2.8973, 2.8973), (-3.0718, -0.0698), (-2.8973, 2.8973), (-0.0175, 3.7525),
    (-2.8973, 2.8973),
)  # fmt: skip
LINK_FRAMES = (
    ((0.0, 0.0, 0.333), 0), ((0.0, 0.0, 0.0), -1), ((0.0, -0.316, 0.0), 1), ((0.0825, 0.0, 0.0), 1),
    ((-0.0825, 0.384, 0.0), -1), ((0.0, 0.0, 0.0), 1), ((0.088, 0.0, 0.0), 1),
)  # fmt: skip
FLANGE = 0.107
HAND_TURN = -math.pi / 4
# Mass, centre of mass, inertia (xx yy zz xy xz yz).
_INERTIALS = (
    (4.970684, "0.003875 0.002081 -0.04762", "0.70337 0.70661 0.0091170 -0.000139 0.0067720 0.019169"),
    (0.646926, "-0.003141 -0.02872 0.003495", "0.0079620 0.02811 0.025995 -0.003925 0.010254 0.000704"),
    (3.228604, "0.027518 0.039252 -0.066502", "0.037242 0.036155 0.01083 -0.004761 -0.011396 -0.012805"),
    (3.587895, "-0.05317 0.104419 0.027454", "0.025853 0.019552 0.028323 0.007796 -0.001332 0.008641"),
    (1.225946, "-0.011953 0.041065 -0.038437", "0.035549 0.029474 0.008627 -0.002117 -0.004037 0.000229"),
    (1.666555, "0.060149 -0.014117 -0.010517", "0.001964 0.004354 0.005433 0.000109 -0.001158 0.000341"),
    (0.735522, "0.010517 -0.004252 0.061597", "0.012516 0.010027 0.004815 -0.000428 -0.001196 -0.000741"),
)
# A third of the usual gains. With higher gains the arm trembles at this time step, and what it holds slips.
_GAINS = (1350, 1350, 1050, 1050, 600, 600, 600)
_FORCES = (87, 87, 87, 87, 12, 12, 12)
# Capsules that show the arm, without collisions.
_LINK_SHAPES = (
    ("0 0 -0.19", "0 0 0.0", 0.07), ("0 -0.12 0", "0 0 0", 0.065), ("0 0 -0.12", "0.06 0 0", 0.06),
    ("-0.06 0.1 0", "0 0 0", 0.06), ("0 0.03 -0.25", "0 0.05 -0.02", 0.055), ("0 0 0", "0.088 0 0", 0.05),
    ("0 0 0.02", "0 0 0.08", 0.045),
)  # fmt: skip


@dataclass(frozen=True)
class Physics:
    """Simulation settings (static: they shape the compiled program).

    Softer pads (MuJoCo's default impedance, `impratio` 1) let a shoe creep out of the grip while it is carried; an
    `impratio` of 20 makes single precision diverge. With 5 solver iterations a shoe slips in the grip, more in MJX than
    in C MuJoCo; more than 10 change nothing in C MuJoCo.
    """

    substeps: int = 10
    iterations: int = 10
    ls_iterations: int = 8
    impratio: float = 3.0
    max_contact_points: int = 16
    grip_gain: float = 400.0
    pad_friction: float = 1.5
    pad_impedance: str = "0.97 0.99 0.001"


def _text(values: Sequence[float]) -> str:
    return " ".join(str(value) for value in values)


def _quarter_turns(turns: int) -> str:
    half = turns * math.pi / 4
    return f"{math.cos(half)} {math.sin(half)} 0 0"


def _arm() -> str:
    """The seven links, each inside the previous one, and the hand inside the last."""
    opening, closing = "", ""
    for number, ((position, turns), inertial, (low, high), shape) in enumerate(
        zip(LINK_FRAMES, _INERTIALS, JOINT_RANGES, _LINK_SHAPES, strict=True), start=1
    ):
        mass, centre, inertia = inertial
        opening += f"""
    <body name="link_{number}" pos="{_text(position)}" quat="{_quarter_turns(turns)}" gravcomp="1">
      <inertial mass="{mass}" pos="{centre}" fullinertia="{inertia}"/>
      <joint name="joint_{number}" axis="0 0 1" range="{low} {high}" armature="0.1" damping="1"/>
      <geom class="arm" size="{shape[2]}" fromto="{shape[0]} {shape[1]}"/>"""
        closing += "</body>"
    return opening + _hand() + closing


def _hand() -> str:
    turn = f"{math.cos(HAND_TURN / 2)} 0 0 {math.sin(HAND_TURN / 2)}"
    fingers = "".join(
        f"""
      <body name="{side}_finger" pos="0 0 {FINGER_DISTANCE}" quat="{quat}" gravcomp="1">
        <inertial mass="0.1" pos="0 0.01 0.02" diaginertia="1e-4 1e-4 1e-4"/>
        <joint name="{side}_finger" type="slide" axis="0 1 0" range="0 {FINGER_OPEN}" armature="0.1" damping="10"/>
        <geom name="{side}_shaft" type="box" pos="{_text(SHAFT[0])}" size="{_text(SHAFT[1])}" rgba=".25 .25 .28 1"/>
        <geom name="{side}_pad" type="box" pos="{_text(PAD[0])}" size="{_text(PAD[1])}" rgba=".2 .2 .2 1"/>
        <geom name="{side}_tip" type="sphere" pos="{_text(TIP_CENTRE)}" size="{TIP_RADIUS}" rgba=".2 .2 .2 1"/>
      </body>"""
        for side, quat in (("left", "1 0 0 0"), ("right", "0 0 0 1"))
    )
    return f"""
      <body name="hand" pos="0 0 {FLANGE}" quat="{turn}" gravcomp="1">
        <inertial mass="0.73" pos="-0.01 0 0.03" diaginertia="0.001 0.0025 0.0017"/>
        <geom name="hand" type="box" size="{_text(HAND)}" pos="0 0 {HAND_CENTRE}" rgba=".9 .9 .92 1"/>
        <geom name="palm" group="3" type="capsule" size="0.02" fromto="0 -0.08 0.038 0 0.08 0.038"/>
        {fingers}
      </body>"""


def _box() -> str:
    """The box's walls, floor, and the lid on its hinge; the box's origin is on the table, under its middle."""
    x, y = INNER
    half_height = WALL_HEIGHT / 2
    walls = (
        ("near", (-x - WALL, 0), (WALL, y + 2 * WALL)),
        ("far", (x + WALL, 0), (WALL, y + 2 * WALL)),
        ("left", (0, y + WALL), (x, WALL)),
        ("right", (0, -y - WALL), (x, WALL)),
    )
    shapes = "".join(
        f'<geom name="{name}_wall" class="card" pos="{cx} {cy} {half_height}" size="{sx} {sy} {half_height}"/>'
        for name, (cx, cy), (sx, sy) in walls
    )
    lid = (x + 2 * WALL, y + 2 * WALL, WALL / 2)
    bar = f"{-BAR_REACH} {-BAR_HALF_LENGTH} 0 {-BAR_REACH} {BAR_HALF_LENGTH} 0"
    posts = "".join(
        f'<geom name="{side}_post" type="capsule" size="0.004" rgba=".3 .3 .3 1"'
        f' fromto="{-2 * lid[0]} {at} 0 {-BAR_REACH} {at} 0"/>'
        for side, at in (("left", BAR_HALF_LENGTH), ("right", -BAR_HALF_LENGTH))
    )
    return f"""
    <body name="box" pos="0.47 0 0">
      <geom name="floor" class="card" pos="0 0 0.001" size="{x} {y} 0.001"/>
      {shapes}
      <body name="lid" pos="{_text(HINGE)}">
        <joint name="lid" axis="0 1 0" range="0 {LID_OPEN}" damping="0.02" frictionloss="0.01" armature="0.001"/>
        <geom name="lid" class="card" pos="{-lid[0]} 0 0" size="{_text(lid)}" mass="{LID_MASS}"/>
        <geom name="bar" type="capsule" size="{BAR_RADIUS}" fromto="{bar}" mass="0.02" rgba=".3 .3 .3 1"/>
        {posts}
      </body>
    </body>"""


def _shoe(name: str, colour: str) -> str:
    return f"""
    <body name="{name}" pos="0.4 0 {SOLE[2]}">
      <freejoint name="{name}"/>
      <geom name="{name}_sole" type="box" size="{_text(SOLE)}" mass="{0.6 * SHOE_MASS}" rgba="{colour}"/>
      <geom name="{name}_upper" type="capsule" size="{UPPER_RADIUS}" mass="{0.4 * SHOE_MASS}" rgba="{colour}"
            fromto="{-UPPER_HALF_LENGTH} 0 {UPPER_HEIGHT} {UPPER_HALF_LENGTH} 0 {UPPER_HEIGHT}"/>
    </body>"""


def _contact_pairs(physics: Physics) -> str:
    sides = ("left", "right")
    walls = ("near_wall", "far_wall", "left_wall", "right_wall")
    uppers = [f"{shoe}_upper" for shoe in SHOE_NAMES]
    grips = [(f"{side}_pad", held) for side in sides for held in ("bar", *uppers)]
    rest = [(f"{shoe}_sole", "table") for shoe in SHOE_NAMES]
    rest += [(upper, part) for upper in uppers for part in (*walls, "lid", "table")] + [tuple(uppers)]
    smooth = [(f"{side}_tip", part) for side in sides for part in (*walls, "table")] + [("palm", "lid")]
    mu, hard = physics.pad_friction, physics.pad_impedance
    return "".join(
        [f'<pair geom1="{a}" geom2="{b}" condim="3" friction="{mu} {mu} 0.01 0 0" solimp="{hard}"/>' for a, b in grips]
        + [f'<pair geom1="{a}" geom2="{b}" condim="3" friction="0.7 0.7 0.01 0 0"/>' for a, b in rest]
        + [f'<pair geom1="{a}" geom2="{b}" condim="1"/>' for a, b in smooth]
    )


def _touches() -> str:
    """Sensors of the contacts between pads and shoes: left and right pad with the first shoe, then with the second."""
    return "".join(
        f'<contact name="{side}_pad_{shoe}" geom1="{side}_pad" geom2="{shoe}_upper" data="found"/>'
        for shoe in SHOE_NAMES
        for side in ("left", "right")
    )


def camera_axes() -> tuple[tuple[float, ...], ...]:
    """The camera's right, up and backward directions in the world."""
    backward = _unit([c - t for c, t in zip(CAMERA, LOOK_AT, strict=True)])
    right = _unit([-backward[1], backward[0], 0.0])
    up = (
        backward[1] * right[2] - backward[2] * right[1],
        backward[2] * right[0] - backward[0] * right[2],
        backward[0] * right[1] - backward[1] * right[0],
    )
    return right, up, backward


def _unit(vector: list[float]) -> tuple[float, ...]:
    length = math.sqrt(sum(value * value for value in vector))
    return tuple(value / length for value in vector)


def scene_xml(physics: Physics) -> str:
    """MJCF of the scene; joint order: seven of the arm, left and right finger, lid, then a free joint per shoe."""
    right, up, _ = camera_axes()
    servos = "".join(
        f'<position joint="joint_{number}" kp="{gain}" kv="{gain / 20}" forcerange="{-force} {force}"/>'
        for number, (gain, force) in enumerate(zip(_GAINS, _FORCES, strict=True), start=1)
    )
    grips = "".join(
        f'<position joint="{side}_finger" kp="{physics.grip_gain}" kv="20" forcerange="-30 30"/>'
        for side in ("left", "right")
    )
    return f"""
<mujoco model="shoes_in_box">
  <compiler angle="radian" autolimits="true"/>
  <option timestep="{CONTROL_DT / physics.substeps}" integrator="implicitfast" solver="Newton" cone="pyramidal"
          impratio="{physics.impratio}" iterations="{physics.iterations}" ls_iterations="{physics.ls_iterations}">
    <flag eulerdamp="disable"/>
  </option>
  <custom><numeric name="max_contact_points" data="{physics.max_contact_points}"/></custom>
  <visual><global offwidth="640" offheight="640"/></visual>
  <default>
    <geom contype="0" conaffinity="0"/>
    <default class="arm"><geom type="capsule" rgba=".93 .93 .95 1" mass="0"/></default>
    <default class="card"><geom type="box" rgba=".72 .53 .34 1"/></default>
  </default>
  <worldbody>
    <light pos="0.5 -0.5 2" dir="0 0.2 -1"/>
    <camera name="front" pos="{_text(CAMERA)}" xyaxes="{_text((*right, *up))}" fovy="{FIELD_OF_VIEW}"/>
    <geom name="table" type="plane" size="1 1 0.1" rgba=".55 .6 .65 1"/>
    <geom name="base" type="cylinder" size="0.08 0.07" pos="0 0 0.07" rgba=".93 .93 .95 1"/>
    {_arm()}
    {_box()}
    {_shoe("shoe_1", ".75 .2 .2 1")}
    {_shoe("shoe_2", ".2 .35 .75 1")}
  </worldbody>
  <contact>{_contact_pairs(physics)}</contact>
  <actuator>{servos}{grips}</actuator>
  <sensor>{_touches()}</sensor>
</mujoco>"""


def build_model(physics: Physics) -> mujoco.MjModel:
    """The compiled MuJoCo model of the scene, the input of an engine."""
    return mujoco.MjModel.from_xml_string(scene_xml(physics))
