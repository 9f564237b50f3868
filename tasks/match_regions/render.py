"""Pictures of Match Regions from above, in plain numpy and PIL: the scene, its boxes, and the reward beside it.

Everything is drawn at twice its size and averaged down, which smooths the edges.
"""

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from tasks.match_regions.env import OBJECTS
from tasks.match_regions.geometry import DRAWN_LOWER, REGION, VIEW_HALF, outline
from tasks.match_regions.model import (
    ARENA_HALF,
    BLOCK_NAMES,
    CONTROL_DT,
    FINGER_BEND,
    FINGER_HALF_THICKNESS,
    FINGER_HINGE,
    FINGER_UPPER,
    ROBOT_RADIUS,
)

Colour = tuple[int, int, int]

BACKGROUND: Colour = (248, 247, 243)
PANEL: Colour = (255, 255, 255)
INK: Colour = (60, 60, 60)
FAINT: Colour = (222, 222, 222)
GREEN: Colour = (91, 168, 92)
BLUE: Colour = (66, 124, 196)
YELLOW: Colour = (236, 190, 50)
REGION_FILL: Colour = (222, 240, 220)
ROBOT_COLOUR: Colour = (150, 150, 156)
FINGER_COLOUR: Colour = (112, 112, 120)
ACTIVE_COLOUR: Colour = (240, 120, 20)
IDLE_COLOUR: Colour = (140, 140, 140)
ROBOT_BOX_COLOUR: Colour = (40, 80, 220)
BLOCK_COLOURS: tuple[Colour, ...] = (GREEN, GREEN, BLUE, YELLOW, YELLOW)

_SCALE = 2


def draw_scene(
    qpos: np.ndarray,
    size: int,
    boxes: np.ndarray | None = None,
    mask: np.ndarray | None = None,
    active: np.ndarray | None = None,
) -> np.ndarray:
    """The scene from above: arena, goal region, robot, blocks and, if given, the objects' boxes.

    Args:
      qpos: (20,) configuration, see `env.PhysicsState`.
      size: pixels along an edge; the image spans [-1.02, 1.02]^2, y up.
      boxes: (N, 4) cx, cy, w, h in [0, 1], origin top left.
      mask: (N,) bool, which boxes are there; all, if left out.
      active: (N,) bool. An active object's box is orange, another's grey; the robot's is blue and dotted.

    Returns:
      (size, size, 3) uint8.
    """
    image = Image.new("RGB", (size * _SCALE, size * _SCALE), BACKGROUND)
    draw = ImageDraw.Draw(image)
    unit = size * _SCALE / (2 * VIEW_HALF)
    line = max(_SCALE, size * _SCALE // 256)

    _draw_region(draw, unit, line)
    draw.polygon(_pixels(_rectangle(-ARENA_HALF, ARENA_HALF, -ARENA_HALF, ARENA_HALF), unit), outline=INK, width=line)
    _draw_robot(draw, qpos[:3], qpos[3:5], unit)
    for block, pose in enumerate(qpos[5:].reshape(len(BLOCK_NAMES), 3)):
        draw.polygon(_pixels(_place(outline(block), pose), unit), fill=BLOCK_COLOURS[block])
    if boxes is not None:
        count = len(boxes)
        present = np.ones(count, bool) if mask is None else mask
        moved = np.zeros(count, bool) if active is None else active
        for box, flag, robot in zip(boxes[present], moved[present], np.array(OBJECTS.is_robot)[present], strict=True):
            _draw_box(draw, box * size * _SCALE, line, bool(flag), bool(robot))
    return np.asarray(image.reduce(_SCALE))


def episode_frames(
    qpos: np.ndarray,
    boxes: np.ndarray,
    mask: np.ndarray,
    active: np.ndarray,
    rewards: np.ndarray,
    size: int = 384,
    label: str = "reward",
) -> np.ndarray:
    """A video of one episode: the scene with its boxes on the left, the reward so far on the right.

    Args:
      qpos: (T, 20).
      boxes: (T, N, 4), see `draw_scene`.
      mask: (T, N) bool.
      active: (T, N) bool.
      rewards: (T,) finite.
      size: pixels along an edge of each half.
      label: what the curve shows.

    Returns:
      (T, size, 2 size, 3) uint8.
    """
    panel = _RewardPanel(rewards, size, label)
    frames = [
        np.concatenate([draw_scene(qpos[t], size, boxes[t], mask[t], active[t]), panel.draw(t)], axis=1)
        for t in range(len(qpos))
    ]
    return np.stack(frames)


class _RewardPanel:
    """The right half of a frame; axes and labels are drawn once, the curve per frame."""

    def __init__(self, rewards: np.ndarray, size: int, label: str):
        self.rewards, self.label = rewards, label
        edge = size * _SCALE
        self.left, self.right, self.top, self.bottom = 0.17 * edge, 0.95 * edge, 0.14 * edge, 0.86 * edge
        low, high = float(np.min(rewards)), float(np.max(rewards))
        margin = 0.05 * (high - low) or 0.5  # a constant reward gets some room too
        self.low, self.high = low - margin, high + margin
        self.font = ImageFont.load_default(edge / 26)
        self.line = max(_SCALE, edge // 200)
        times = np.arange(len(rewards)) / max(len(rewards) - 1, 1)
        heights = (rewards - self.low) / (self.high - self.low)
        self.points = [
            (self.left + t * (self.right - self.left), self.bottom - h * (self.bottom - self.top))
            for t, h in zip(times.tolist(), heights.tolist(), strict=True)
        ]
        self.image = self._background(edge)

    def _background(self, edge: int) -> Image.Image:
        image = Image.new("RGB", (edge, edge), PANEL)
        draw = ImageDraw.Draw(image)
        gap = 0.015 * edge
        for share in (0.0, 0.25, 0.5, 0.75, 1.0):
            y = self.bottom - share * (self.bottom - self.top)
            x = self.left + share * (self.right - self.left)
            seconds = share * (len(self.rewards) - 1) * CONTROL_DT
            draw.line([(self.left, y), (self.right, y)], fill=FAINT, width=_SCALE)
            value = f"{self.low + share * (self.high - self.low):.2f}"
            draw.text((self.left - gap, y), value, fill=INK, font=self.font, anchor="rm")
            draw.text((x, self.bottom + gap), f"{seconds:.1f}", fill=INK, font=self.font, anchor="mt")
        draw.line([(self.left, self.top), (self.left, self.bottom), (self.right, self.bottom)], fill=INK, width=_SCALE)
        middle = (self.left + self.right) / 2
        draw.text((middle, self.bottom + 0.07 * edge), "time (s)", fill=INK, font=self.font, anchor="mt")
        return image

    def draw(self, step: int) -> np.ndarray:
        """The curve up to and including `step`, its current value written above: (size, size, 3) uint8."""
        image = self.image.copy()
        draw = ImageDraw.Draw(image)
        title = f"{self.label}: {self.rewards[step]:.3f}"
        draw.text((self.left, 0.05 * image.height), title, fill=INK, font=self.font, anchor="lt")
        draw.line(self.points[: step + 1], fill=GREEN, width=self.line, joint="curve")
        draw.circle(self.points[step], 1.5 * self.line, fill=INK)
        return np.asarray(image.reduce(_SCALE))


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
    """Arena points (V, 2) in pixels, `unit` of them per arena unit."""
    return [((x + VIEW_HALF) * unit, (VIEW_HALF - y) * unit) for x, y in points.tolist()]


def _rectangle(west: float, east: float, south: float, north: float) -> np.ndarray:
    """Corners of a rectangle: (4, 2)."""
    return np.array([[west, south], [east, south], [east, north], [west, north]])


def _draw_region(draw: ImageDraw.ImageDraw, unit: float, line: int) -> None:
    corners = _pixels(_rectangle(*REGION), unit)
    draw.polygon(corners, fill=REGION_FILL)
    _draw_broken(draw, corners, GREEN, line, dash=0.04 * unit, gap=0.03 * unit)


def _draw_robot(draw: ImageDraw.ImageDraw, pose: np.ndarray, fingers: np.ndarray, unit: float) -> None:
    thickness = FINGER_HALF_THICKNESS * unit
    for finger in finger_lines(fingers):
        points = _pixels(_place(finger, pose), unit)
        draw.line(points, fill=FINGER_COLOUR, width=round(2 * thickness))
        for point in points:  # round ends and elbow
            draw.circle(point, thickness, fill=FINGER_COLOUR)
    (centre,) = _pixels(pose[None, :2], unit)
    draw.circle(centre, ROBOT_RADIUS * unit, fill=ROBOT_COLOUR)


def _draw_box(draw: ImageDraw.ImageDraw, box: np.ndarray, line: int, active: bool, robot: bool) -> None:
    """One box (4,) cx, cy, w, h in pixels."""
    (x, y), (half_width, half_height) = box[:2].tolist(), (box[2:] / 2).tolist()
    west, east, north, south = x - half_width, x + half_width, y - half_height, y + half_height
    if robot:
        corners = [(west, south), (east, south), (east, north), (west, north)]
        _draw_broken(draw, corners, ROBOT_BOX_COLOUR, line, dash=2 * line, gap=2 * line)
    else:
        draw.rectangle([west, north, east, south], outline=ACTIVE_COLOUR if active else IDLE_COLOUR, width=line)


def _draw_broken(
    draw: ImageDraw.ImageDraw, corners: list[tuple[float, float]], colour: Colour, width: int, dash: float, gap: float
) -> None:
    """The outline through `corners`, closed, in dashes (all in pixels)."""
    ends = np.array(corners)
    for start, end in zip(ends, np.roll(ends, -1, axis=0), strict=True):
        length = float(np.linalg.norm(end - start))
        for offset in np.arange(0.0, length, dash + gap):
            piece = np.array([offset, min(offset + dash, length)])[:, None] / max(length, 1e-9)
            draw.line([tuple(point) for point in (start + piece * (end - start)).tolist()], fill=colour, width=width)
