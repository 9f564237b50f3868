"""Small made-up graphs for the tests.

They are numpy arrays: the first use of every jax operation on every shape is a compilation, and tests are many.
"""

from dataclasses import replace

import jax
import numpy as np

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


def pad(graph: Graph, num_slots: int) -> Graph:
    """The same graph with masked slots behind its own, `num_slots` in all."""

    def padded(field: np.ndarray) -> np.ndarray:
        return np.pad(field, [(0, num_slots - len(field))] + [(0, 0)] * (field.ndim - 1))

    return jax.tree.map(padded, graph)


def overwrite_slot(graph: Graph, slot: int, value: float) -> Graph:
    """The same graph with `value` in every number of one slot and True in its flags, except for the mask."""

    def overwritten(field: np.ndarray) -> np.ndarray:
        field = field.copy()
        field[slot] = True if field.dtype == bool else value
        return field

    return replace(jax.tree.map(overwritten, graph), mask=graph.mask)
