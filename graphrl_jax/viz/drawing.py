"""Drawing functions for all tasks: the objects' boxes and a curve of the reward so far. NumPy and PIL.

`RewardPanel` draws at `SCALE` times its size and averages down, which smooths the edges.
"""

import math

import jax
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from graphrl_jax.demonstrations import Demonstrations
from graphrl_jax.graph import activity

Colour = tuple[int, int, int]
Font = ImageFont.FreeTypeFont | ImageFont.ImageFont

PANEL: Colour = (255, 255, 255)
INK: Colour = (60, 60, 60)
FAINT: Colour = (222, 222, 222)
CURVE: Colour = (91, 168, 92)
ACTIVE_COLOUR: Colour = (240, 120, 20)
IDLE_COLOUR: Colour = (140, 140, 140)
ROBOT_BOX_COLOUR: Colour = (40, 80, 220)

SCALE = 2
LEAST_SIDE = 480
"""Pixels of an overlay's shorter side: names on smaller images could not be read."""


def draw_boxes(
    draw: ImageDraw.ImageDraw,
    edge: int,
    line: int,
    boxes: np.ndarray,
    mask: np.ndarray | None,
    active: np.ndarray | None,
    is_robot: tuple[bool, ...],
) -> None:
    """Draws boxes (N, 4) on a square image of `edge` pixels: active objects orange, others grey, robots dotted blue."""
    count = len(boxes)
    present = np.ones(count, bool) if mask is None else mask
    moved = np.zeros(count, bool) if active is None else active
    for box, flag, robot in zip(boxes[present], moved[present], np.array(is_robot)[present], strict=True):
        _draw_box(draw, box * edge, line, bool(flag), bool(robot))


class RewardPanel:
    """Plot of the reward over time, `size` pixels square; axes and labels are drawn once, the curve per frame."""

    def __init__(self, rewards: np.ndarray, size: int, label: str, frame_rate: float):
        self.rewards, self.label, self.frame_rate = rewards, label, frame_rate
        edge = size * SCALE
        self.left, self.right, self.top, self.bottom = 0.17 * edge, 0.95 * edge, 0.14 * edge, 0.86 * edge
        low, high = float(np.min(rewards)), float(np.max(rewards))
        margin = 0.05 * (high - low) or 0.5  # a constant reward also needs a margin
        self.low, self.high = low - margin, high + margin
        self.font = ImageFont.load_default(edge / 26)
        self.line = max(SCALE, edge // 200)
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
            seconds = share * (len(self.rewards) - 1) / self.frame_rate
            draw.line([(self.left, y), (self.right, y)], fill=FAINT, width=SCALE)
            value = f"{self.low + share * (self.high - self.low):.2f}"
            draw.text((self.left - gap, y), value, fill=INK, font=self.font, anchor="rm")
            draw.text((x, self.bottom + gap), f"{seconds:.1f}", fill=INK, font=self.font, anchor="mt")
        draw.line([(self.left, self.top), (self.left, self.bottom), (self.right, self.bottom)], fill=INK, width=SCALE)
        middle = (self.left + self.right) / 2
        draw.text((middle, self.bottom + 0.07 * edge), "time (s)", fill=INK, font=self.font, anchor="mt")
        return image

    def draw(self, step: int) -> np.ndarray:
        """Image of the curve up to and including `step`, with its current value above: (size, size, 3) uint8."""
        image = self.image.copy()
        draw = ImageDraw.Draw(image)
        title = f"{self.label}: {self.rewards[step]:.3f}"
        draw.text((self.left, 0.05 * image.height), title, fill=INK, font=self.font, anchor="lt")
        draw.line(self.points[: step + 1], fill=CURVE, width=self.line, joint="curve")
        draw.circle(self.points[step], 1.5 * self.line, fill=INK)
        return np.asarray(image.reduce(SCALE))


def _draw_box(draw: ImageDraw.ImageDraw, box: np.ndarray, line: int, active: bool, robot: bool) -> None:
    """Draws one box (4,) cx, cy, w, h in pixels."""
    (x, y), (half_width, half_height) = box[:2].tolist(), (box[2:] / 2).tolist()
    west, east, north, south = x - half_width, x + half_width, y - half_height, y + half_height
    if robot:
        corners = [(west, south), (east, south), (east, north), (west, north)]
        draw_broken(draw, corners, ROBOT_BOX_COLOUR, line, dash=2 * line, gap=2 * line)
    else:
        draw.rectangle([west, north, east, south], outline=ACTIVE_COLOUR if active else IDLE_COLOUR, width=line)


def draw_broken(
    draw: ImageDraw.ImageDraw, corners: list[tuple[float, float]], colour: Colour, width: int, dash: float, gap: float
) -> None:
    """Draws a closed dashed line through `corners` (all in pixels)."""
    ends = np.array(corners)
    for start, end in zip(ends, np.roll(ends, -1, axis=0), strict=True):
        length = float(np.linalg.norm(end - start))
        for offset in np.arange(0.0, length, dash + gap):
            piece = np.array([offset, min(offset + dash, length)])[:, None] / max(length, 1e-9)
            draw.line([tuple(point) for point in (start + piece * (end - start)).tolist()], fill=colour, width=width)


def overlay(frames: np.ndarray, demonstration: Demonstrations, tau: float) -> np.ndarray:
    """Frames with every object's box and name: orange once it has moved, blue for the robot.

    Args:
      frames: (T, H, W, 3) uint8.
      demonstration: the demonstration of these frames, a set of one.
      tau: activity threshold, see `graph.update_activity`.

    Returns:
      (T, s H, s W, 3) uint8, where s is the least whole number that makes the shorter side `LEAST_SIDE` or more.
    """
    boxes, mask = demonstration.boxes[0], demonstration.mask[0]
    active = np.asarray(jax.jit(activity)(boxes, mask, tau))
    factor = math.ceil(LEAST_SIDE / min(frames.shape[1:3]))
    height, width = (factor * side for side in frames.shape[1:3])
    scale = np.array([width, height])
    font = ImageFont.load_default(height / 30)
    objects = demonstration.objects
    drawn = []
    for frame, seen, moved, places in zip(frames, mask, active, boxes, strict=False):
        image = Image.fromarray(frame.repeat(factor, axis=0).repeat(factor, axis=1))
        draw = ImageDraw.Draw(image)
        for slot in np.flatnonzero(seen):
            colour = ROBOT_BOX_COLOUR if objects.is_robot[slot] else ACTIVE_COLOUR if moved[slot] else IDLE_COLOUR
            low = (places[slot, :2] - places[slot, 2:] / 2) * scale
            high = (places[slot, :2] + places[slot, 2:] / 2) * scale
            draw.rectangle([*low.tolist(), *(high - 1).tolist()], outline=colour, width=height // 240)
            _draw_name(draw, low.tolist(), objects.names[slot], colour, font)
        drawn.append(np.asarray(image))
    return np.stack(drawn)


def _draw_name(draw: ImageDraw.ImageDraw, corner: list[float], name: str, colour: Colour, font: Font) -> None:
    """Draws a name on a background of its box's colour: above the box's upper left corner, below it at the top edge."""
    _, top, right, bottom = draw.textbbox((0, 0), name, font=font)
    margin = (bottom - top) / 4
    width, height = right + 2 * margin, bottom - top + 2 * margin
    x, y = corner[0], corner[1] - height if corner[1] >= height else corner[1]
    draw.rectangle([x, y, x + width, y + height], fill=colour)
    draw.text((x + margin, y + margin - top), name, fill=PANEL, font=font)
