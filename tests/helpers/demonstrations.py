"""Small made-up demonstrations for the tests."""

from dataclasses import replace

import numpy as np

from graphrl_jax.demonstrations import Demonstrations
from tests.helpers.graphs import OBJECTS


def demonstrations(num: int = 6, num_frames: int = 14, seed: int = 0) -> Demonstrations:
    """A robot that walks to a block and carries it into a region; start and speed vary, the last slot is masked."""
    random = np.random.default_rng(seed)
    lengths = random.integers(num_frames - 4, num_frames + 1, num).astype(np.int32)
    lengths[0] = num_frames
    boxes = np.zeros((num, num_frames, 4, 4), np.float32)
    boxes[..., 2:] = 0.2
    for index, length in enumerate(lengths):
        robot, block, region = np.array([0.1, 0.1]), np.array([0.4, 0.8]), np.array([0.8, 0.3])
        robot = robot + random.normal(0, 0.03, 2)
        progress = np.linspace(0, 2, length)[:, None]
        reach, carry = np.clip(progress, 0, 1), np.clip(progress - 1, 0, 1)
        boxes[index, :length, 0, :2] = robot + reach * (block - robot) + carry * (region - block)
        boxes[index, :length, 1, :2] = block + carry * (region - block)
        boxes[index, :length, 2, :2] = region
    mask = np.ones((num, num_frames, 4), bool)
    mask[..., 3] = False
    return Demonstrations(boxes, mask, lengths, np.ones(num, bool), OBJECTS, 8.0, "synthetic", "carry")


def with_images(demos: Demonstrations, size: int) -> Demonstrations:
    """The same demonstrations with images of `size` pixels: a bright spot per object, each in a colour of its own."""
    ticks = (np.arange(size) + 0.5) / size
    centres = demos.boxes[:, :, :3, None, None, :2]
    squares = (ticks - centres[..., 0]) ** 2 + (ticks[:, None] - centres[..., 1]) ** 2
    images = np.moveaxis(255 * np.exp(-squares / 0.02), 2, -1)
    return replace(demos, frames=images.astype(np.uint8))
