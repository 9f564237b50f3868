"""Small made-up graphs and demonstrations for the tests.

They are numpy arrays: the first use of every jax operation on every shape is a compilation, and tests are many.
"""

from dataclasses import replace

import jax
import numpy as np

from graphrl_jax.demonstrations import Demonstrations
from graphrl_jax.graph import Graph, ObjectTable

OBJECTS = ObjectTable(
    names=("robot", "block", "region", "absent"),
    class_ids=(0, 1, 2, 1),
    is_robot=(True, False, False, False),
    class_names=("robot", "block", "region"),
)


def random_graph(seed: int, num_slots: int = 5, num_classes: int = 3) -> Graph:
    """A random graph; slot 0 is the robot, slot 1 has moved, and all but the last slot are unmasked."""
    random = np.random.default_rng(seed)
    slots = np.arange(num_slots)
    return Graph(
        boxes=random.uniform(0, 1, (num_slots, 4)).astype(np.float32),
        mask=slots < num_slots - 1,
        classes=np.eye(num_classes, dtype=np.float32)[random.integers(0, num_classes, num_slots)],
        robot=slots == 0,
        active=slots == 1,
    )


def permute(graph: Graph, order: np.ndarray) -> Graph:
    """The same graph with its slots in another order."""
    return jax.tree.map(lambda field: field[order], graph)


def overwrite_slot(graph: Graph, slot: int, value: float) -> Graph:
    """The same graph with `value` in every number of one slot and True in its flags, except for the mask."""

    def overwritten(field: np.ndarray) -> np.ndarray:
        field = field.copy()
        field[slot] = True if field.dtype == bool else value
        return field

    return replace(jax.tree.map(overwritten, graph), mask=graph.mask)


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
