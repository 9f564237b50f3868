"""Frames as MAGICAL draws them, in miniature: flat colours with an outline, the robot on top."""

import math

import numpy as np
from PIL import Image, ImageDraw

from tasks.match_regions import geometry, magical

GREEN, YELLOW, BLUE = (magical.LOOKS[index] for index in (2, 5, 4))
# Shape, its colours, where it lies (arena units) and its angle.
SCENE = {
    "star": (geometry.STAR, GREEN, (0.8, -0.7), 0.4),
    "square": (geometry.SQUARE, GREEN, (-0.68, 0.72), 1.28),
    "blue_pentagon": (geometry.PENTAGON, BLUE, (-0.05, -0.2), -1.09),
    "yellow_circle": (geometry.CIRCLE, YELLOW, (-0.75, -0.55), 0.0),
    "yellow_pentagon": (geometry.PENTAGON, YELLOW, (0.3, -0.82), -1.15),
}


def pixels(points: np.ndarray, size: int) -> list[tuple[float, float]]:
    """Points (P, 2) of the arena in an image of `size` pixels."""
    scaled = np.stack([points[:, 0] + geometry.VIEW_HALF, geometry.VIEW_HALF - points[:, 1]], -1)
    return [tuple(point) for point in (scaled * size / (2 * geometry.VIEW_HALF)).tolist()]


def draw(
    size: int = 384, moved: dict[str, tuple[float, float]] | None = None, without: tuple[str, ...] = ()
) -> np.ndarray:
    """A frame (size, size, 3) uint8 of the region, the robot's body and the blocks, some of them moved or left out."""
    image = Image.new("RGB", (size, size), (255, 255, 255))
    canvas = ImageDraw.Draw(image)
    wall = round(0.01 * size)
    canvas.rectangle((0, 0, size - 1, size - 1), outline=(231, 231, 234), width=wall)
    west, east, south, north = geometry.REGION
    canvas.rectangle([*pixels(np.array([[west, north]]), size)[0], *pixels(np.array([[east, south]]), size)[0]],
                     fill=magical.LOOKS[0].fill[0])  # fmt: skip
    for name, (shape, look, place, angle) in SCENE.items():
        if name in without:
            continue
        turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
        corners = geometry.outline(shape) @ turn.T + np.array((moved or {}).get(name, place))
        canvas.polygon(pixels(corners, size), fill=look.fill[0], outline=look.outline[0], width=max(1, size // 150))
    (left, top), (right, bottom) = pixels(np.array([[-0.7, 0.3], [-0.3, -0.1]]), size)
    canvas.ellipse((left, top, right, bottom), fill=magical.LOOKS[1].fill[0])
    return np.asarray(image)
