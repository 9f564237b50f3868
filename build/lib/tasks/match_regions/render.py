"""Drawings of Match Regions from above, in NumPy and PIL: the scene, its boxes, and the reward beside it."""

import numpy as np
from PIL import Image, ImageDraw

from graphrl_jax.viz.drawing import INK, SCALE, Colour, RewardPanel, draw_boxes, draw_broken
from tasks.match_regions.geometry import DRAWN_LOWER, VIEW_HALF, outline
from tasks.match_regions.layouts import World
from tasks.match_regions.model import (
    ARENA_HALF,
    CONTROL_DT,
    FINGER_BEND,
    FINGER_HALF_THICKNESS,
    FINGER_HINGE,
    FINGER_UPPER,
    ROBOT_RADIUS,
)

BACKGROUND: Colour = (248, 247, 243)
BLOCK_COLOURS: tuple[Colour, ...] = ((205, 84, 80), (91, 168, 92), (66, 124, 196), (236, 190, 50))
REGION_FILLS: tuple[Colour, ...] = ((246, 224, 222), (222, 240, 220), (218, 230, 244), (250, 240, 210))
"""Fill by colour, see `layouts.COLOURS`."""
ROBOT_COLOUR: Colour = (150, 150, 156)
FINGER_COLOUR: Colour = (112, 112, 120)
_ROBOT_SLOT = 1


def draw_scene(
    qpos: np.ndarray,
    world: World,
    size: int,
    boxes: np.ndarray | None = None,
    mask: np.ndarray | None = None,
    active: np.ndarray | None = None,
) -> np.ndarray:
    """The scene from above: arena, goal region, robot, blocks and, if given, the objects' boxes.

    Args:
      qpos: (5 + 3M,) configuration, see `state.PhysicsState`.
      world: region and blocks, on the host.
      size: pixels along an edge; the image spans [-1.02, 1.02]^2, y up.
      boxes: (N, 4) cx, cy, w, h in [0, 1], origin top left.
      mask: (N,) bool, boxes that are present; default: all.
      active: (N,) bool. Boxes of active objects are orange, others grey; the robot's box is blue and dotted.

    Returns:
      (size, size, 3) uint8.
    """
    image = Image.new("RGB", (size * SCALE, size * SCALE), BACKGROUND)
    draw = ImageDraw.Draw(image)
    unit = size * SCALE / (2 * VIEW_HALF)
    line = max(SCALE, size * SCALE // 256)

    _draw_region(draw, world, unit, line)
    draw.polygon(_pixels(_rectangle(-ARENA_HALF, ARENA_HALF, -ARENA_HALF, ARENA_HALF), unit), outline=INK, width=line)
    _draw_robot(draw, qpos[:3], qpos[3:5], unit)
    for block in np.flatnonzero(world.present):
        corners = _place(outline(world.shapes[block]), qpos[5 + 3 * block : 8 + 3 * block])
        draw.polygon(_pixels(corners, unit), fill=BLOCK_COLOURS[world.colours[block]])
    if boxes is not None:
        draw_boxes(draw, size * SCALE, line, boxes, mask, active, np.arange(len(boxes)) == _ROBOT_SLOT)
    return np.asarray(image.reduce(SCALE))


def episode_frames(
    qpos: np.ndarray,
    worlds: World,
    boxes: np.ndarray,
    mask: np.ndarray,
    active: np.ndarray,
    rewards: np.ndarray,
    size: int = 384,
    label: str = "reward",
) -> np.ndarray:
    """A video of one episode: the scene with its boxes on the left, the reward so far on the right.

    Args:
      qpos: (T, 5 + 3M).
      worlds: leaves (T, ...); the frames of an episode share one world.
      boxes: (T, N, 4), see `draw_scene`.
      mask: (T, N) bool.
      active: (T, N) bool.
      rewards: (T,) finite.
      size: pixels along an edge of each half.
      label: what the curve shows.

    Returns:
      (T, size, 2 size, 3) uint8.
    """
    panel = RewardPanel(rewards, size, label, 1 / CONTROL_DT)
    world = World(*(np.asarray(leaf)[0] for leaf in worlds))
    frames = [
        np.concatenate([draw_scene(qpos[t], world, size, boxes[t], mask[t], active[t]), panel.draw(t)], axis=1)
        for t in range(len(qpos))
    ]
    return np.stack(frames)


def finger_lines(fingers: np.ndarray) -> np.ndarray:
    """Hinge, elbow and tip of both fingers in the robot's frame, as `geometry.finger_points` but on the host.

    Args:
      fingers: (2,) joint angles, left and right, radians.

    Returns:
      (2, 3, 2).
    """
    lines = []
    for sign, angle in zip((-1.0, 1.0), fingers, strict=True):
        tip = [
            -sign * DRAWN_LOWER * np.sin(FINGER_BEND),
            FINGER_UPPER + DRAWN_LOWER * np.cos(FINGER_BEND),
        ]
        hinge = [sign * FINGER_HINGE[0], FINGER_HINGE[1]]
        lines.append(_place(np.array([[0.0, 0.0], [0.0, FINGER_UPPER], tip]), np.array([*hinge, angle])))
    return np.stack(lines)


def _place(points: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """Turns points (V, 2) by the pose's angle, counter-clockwise, and moves them; `pose` (3,) is x, y, theta."""
    cosine, sine = np.cos(pose[2]), np.sin(pose[2])
    return points @ np.array([[cosine, sine], [-sine, cosine]]) + pose[:2]


def _pixels(points: np.ndarray, unit: float) -> list[tuple[float, float]]:
    """Arena points (V, 2) in pixels, with `unit` pixels per arena unit."""
    return [((x + VIEW_HALF) * unit, (VIEW_HALF - y) * unit) for x, y in points.tolist()]


def _rectangle(west: float, east: float, south: float, north: float) -> np.ndarray:
    """Corners of a rectangle: (4, 2)."""
    return np.array([[west, south], [east, south], [east, north], [west, north]])


def _draw_region(draw: ImageDraw.ImageDraw, world: World, unit: float, line: int) -> None:
    corners = _pixels(_rectangle(*world.region), unit)
    draw.polygon(corners, fill=REGION_FILLS[world.region_colour])
    draw_broken(draw, corners, BLOCK_COLOURS[world.region_colour], line, dash=0.04 * unit, gap=0.03 * unit)


def _draw_robot(draw: ImageDraw.ImageDraw, pose: np.ndarray, fingers: np.ndarray, unit: float) -> None:
    thickness = FINGER_HALF_THICKNESS * unit
    for finger in finger_lines(fingers):
        points = _pixels(_place(finger, pose), unit)
        draw.line(points, fill=FINGER_COLOUR, width=round(2 * thickness))
        for point in points:  # round ends and elbow
            draw.circle(point, thickness, fill=FINGER_COLOUR)
    (centre,) = _pixels(pose[None, :2], unit)
    draw.circle(centre, ROBOT_RADIUS * unit, fill=ROBOT_COLOUR)
