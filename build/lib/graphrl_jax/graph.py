"""The graph of one frame: objects as nodes, their image-plane boxes as features, and flags of objects that have moved.

Symbols used in every docstring of this package:

    B batch (demonstrations, environments)      E edges or events      D size of the graph embedding
    T time (frames)                             H hidden features      C object classes
    N node slots (one per object of the task; a slot may be masked)

Boxes are (cx, cy, w, h) in image coordinates scaled to [0, 1], origin at the top left. All floats are float32.
Functions take one graph or one sequence; map over batches with `jax.vmap`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

BOX_FEATURES, EDGE_FEATURES = 4, 3
INPUT_SCALE = 5.0
"""Factor on boxes and offsets at the input of a network. Positions and offsets vary by about a fifth of the image;
without the factor a network learns a step at the edge of a region instead of a basin around it."""


@dataclass(frozen=True)
class ObjectTable:
    """The object in each node slot. Hashable, so it can be a static argument of a jitted function.

    | field       | shape | type  | meaning                                     |
    |-------------|-------|-------|---------------------------------------------|
    | names       | (N,)  | str   | one unique name per slot                    |
    | class_ids   | (N,)  | int   | index into class_names                      |
    | is_robot    | (N,)  | bool  | the slot is the robot or a part of it       |
    | class_names | (C,)  | str   | unique; a class may have no object          |
    | is_fixture  | (N,)  | bool  | the slot is a fixture, such as a goal region; default: no fixtures |
    | is_articulated | (N,) | bool | the slot moves along a track of its own, such as a lid; default: none |

    Raises:
      ValueError: a field has the wrong length, a wrong type or a value out of range; the message names it.
    """

    names: tuple[str, ...]
    class_ids: tuple[int, ...]
    is_robot: tuple[bool, ...]
    class_names: tuple[str, ...]
    is_fixture: tuple[bool, ...] = ()
    is_articulated: tuple[bool, ...] = ()

    def __post_init__(self) -> None:
        # Lists and numpy scalars are accepted; tuples of plain values keep the table hashable.
        object.__setattr__(self, "names", _plain("names", self.names, str))
        object.__setattr__(self, "class_ids", _plain("class_ids", self.class_ids, int))
        object.__setattr__(self, "is_robot", _plain("is_robot", self.is_robot, bool))
        object.__setattr__(self, "class_names", _plain("class_names", self.class_names, str))
        for field in ("is_fixture", "is_articulated"):
            flags = _plain(field, getattr(self, field), bool) or (False,) * self.num_slots
            object.__setattr__(self, field, flags)
        for field in ("names", "class_names"):
            values = getattr(self, field)
            if not values or len(set(values)) != len(values):
                raise ValueError(f"ObjectTable.{field} must hold at least one name and no name twice, got {values}")
        for field in ("class_ids", "is_robot", "is_fixture", "is_articulated"):
            values = getattr(self, field)
            if len(values) != self.num_slots:
                raise ValueError(
                    f"ObjectTable.{field} has {len(values)} entries, but names has {self.num_slots}: {self.names}"
                )
        for class_id in self.class_ids:
            if not 0 <= class_id < self.num_classes:
                raise ValueError(f"ObjectTable.class_ids holds {class_id}; allowed are 0 to {self.num_classes - 1}")

    @property
    def num_slots(self) -> int:
        """N, the number of node slots."""
        return len(self.names)

    @property
    def num_classes(self) -> int:
        """C, the number of object classes."""
        return len(self.class_names)

    def class_one_hot(self) -> jax.Array:
        """One-hot class of each slot: (N, C) float32."""
        return jnp.asarray(np.eye(self.num_classes, dtype=np.float32)[list(self.class_ids)])

    def robot_flags(self) -> jax.Array:
        """Whether each slot is the robot: (N,) bool."""
        return jnp.asarray(self.is_robot, dtype=bool)

    def fixture_flags(self) -> jax.Array:
        """Whether each slot is a fixture: (N,) bool."""
        return jnp.asarray(self.is_fixture, dtype=bool)

    def articulated_flags(self) -> jax.Array:
        """Whether each slot is articulated: (N,) bool."""
        return jnp.asarray(self.is_articulated, dtype=bool)


def _plain(field: str, values: Sequence, kind: type) -> tuple:
    """The values as a tuple of plain `kind` objects; numpy scalars are unwrapped."""
    if isinstance(values, str):
        raise ValueError(f"ObjectTable.{field} must be a sequence of {kind.__name__}, got the string {values!r}")
    plain = tuple(value.item() if isinstance(value, np.generic) else value for value in values)
    for value in plain:
        if type(value) is not kind:
            raise ValueError(f"ObjectTable.{field} must hold {kind.__name__} values only, got {value!r}")
    return plain


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Graph:
    """The objects of one frame. Fully connected, without self-loops; edge features follow from the boxes.

    | field   | shape  | dtype   | meaning                                                         |
    |---------|--------|---------|-----------------------------------------------------------------|
    | boxes   | (N, 4) | float32 | cx, cy, w, h in [0, 1], origin top left                         |
    | mask    | (N,)   | bool    | the object is present; a masked slot (False) affects no result  |
    | classes | (N, C) | float32 | one-hot class                                                   |
    | robot   | (N,)   | bool    | the node is the robot                                           |
    | active  | (N,)   | bool    | the object has moved in this episode                            |

    A sequence or a batch of graphs has leading axes (T, ...) or (B, ...) on every field.
    """

    boxes: jax.Array
    mask: jax.Array
    classes: jax.Array
    robot: jax.Array
    active: jax.Array


def build_graph(
    objects: ObjectTable,
    boxes: jax.Array,
    mask: jax.Array,
    active: jax.Array,
    class_ids: jax.Array | None = None,
) -> Graph:
    """The graph of one frame.

    Args:
      objects: the object in each slot.
      boxes: (N, 4) float32; any value in a masked slot.
      mask: (N,) bool, False where the object is absent.
      active: (N,) bool, see `activity`.
      class_ids: (N,) int32, for tasks in which objects change between episodes; default: the table's.
    """
    slots = objects.num_slots
    if boxes.shape != (slots, 4) or mask.shape != (slots,) or active.shape != (slots,):
        raise ValueError(
            f"build_graph takes boxes ({slots}, 4), mask ({slots},) and active ({slots},) for this object table, "
            f"got {boxes.shape}, {mask.shape} and {active.shape}; map over batches with jax.vmap"
        )
    classes = objects.class_one_hot() if class_ids is None else jax.nn.one_hot(class_ids, objects.num_classes)
    return Graph(boxes, mask, classes, objects.robot_flags(), active)


def clear_masked_slots(graph: Graph) -> Graph:
    """The same graph with zeros in every masked slot, so that not even a NaN there can reach a result."""
    mask = graph.mask
    return Graph(
        boxes=jnp.where(mask[:, None], graph.boxes, 0.0),
        mask=mask,
        classes=jnp.where(mask[:, None], graph.classes, 0.0),
        robot=graph.robot & mask,
        active=graph.active & mask,
    )


def edge_features(boxes: jax.Array) -> jax.Array:
    """Offset of the sender's centre from the receiver's centre, and their distance.

    Args:
      boxes: (N, 4) float32.

    Returns:
      (N, N, 3) float32; [i, j] = (dx, dy, distance) from node i (receiver) to node j (sender).
    """
    centres = boxes[:, :2]
    offsets = centres[None, :, :] - centres[:, None, :]
    return jnp.concatenate([offsets, safe_norm(offsets)[..., None]], axis=-1)


class ActivityState(NamedTuple):
    """Activity so far in an episode, and the boxes that the next frame's are compared with.

    | field           | shape  | dtype   | meaning                                                            |
    |-----------------|--------|---------|--------------------------------------------------------------------|
    | active          | (N,)   | bool    | the object has moved                                               |
    | reference_boxes | (N, 4) | float32 | boxes where objects were first seen, or those of the last frame    |
    | reference_mask  | (N,)   | bool    | the object has a reference                                         |
    """

    active: jax.Array
    reference_boxes: jax.Array
    reference_mask: jax.Array


def begin_activity(boxes: jax.Array, mask: jax.Array, active: jax.Array | None = None) -> ActivityState:
    """Activity in the first frame of an episode.

    Args:
      boxes: (N, 4) float32.
      mask: (N,) bool.
      active: (N,) bool, objects that count as moved from the start; default: none.
    """
    return ActivityState(jnp.zeros(mask.shape, bool) if active is None else active, boxes, mask)


def update_activity(
    state: ActivityState, boxes: jax.Array, mask: jax.Array, tau: ArrayLike, rule: str = "displacement"
) -> ActivityState:
    """Activity after one more frame: an object is active once it is more than `tau` box diagonals from its reference.

    active_i(t) = active_i(t-1) or ||c_i(t) - reference_i|| > tau * diagonal_i(t). An object that is absent in this
    frame, or has no reference, cannot become active. The rules differ in the reference:

    - `displacement`: where the object was first seen in the episode. This depends neither on the frame rate nor, up to
      tau, on the detector's jitter.
    - `frame_motion`: where it is in the previous frame (an ablation).
    - `momentary`: as `frame_motion`, but an object is active only in the frames in which it moves (an ablation).

    Args:
      state: activity at t-1.
      boxes: (N, 4) float32 at t; for the ablations, at the full frame rate.
      mask: (N,) bool at t.
      tau: threshold, as a share of the box's diagonal; per frame in the ablations.
      rule: static, one of `encoder.config.ACTIVITY_RULES`.
    """
    moved_by = safe_norm(boxes[:, :2] - state.reference_boxes[:, :2])
    # A product instead of a quotient, because a box of zero size would be a division by zero.
    moved = (moved_by > tau * safe_norm(boxes[:, 2:])) & mask & state.reference_mask
    active = moved if rule == "momentary" else state.active | moved
    if rule != "displacement":
        return ActivityState(active, boxes, mask)
    seen = state.reference_mask
    return ActivityState(active, jnp.where(seen[:, None], state.reference_boxes, boxes), seen | mask)


def activity(boxes: jax.Array, mask: jax.Array, tau: ArrayLike, rule: str = "displacement") -> jax.Array:
    """Activity flags of a sequence; all are False in the first frame.

    Args:
      boxes: (T, N, 4) float32.
      mask: (T, N) bool.
      tau, rule: see `update_activity`.

    Returns:
      (T, N) bool.
    """

    def advance(state: ActivityState, frame: tuple[jax.Array, jax.Array]) -> tuple[ActivityState, jax.Array]:
        state = update_activity(state, *frame, tau, rule)
        return state, state.active

    return jax.lax.scan(advance, begin_activity(boxes[0], mask[0]), (boxes, mask))[1]


def sequence_graphs(
    objects: ObjectTable,
    boxes: jax.Array,
    mask: jax.Array,
    length: ArrayLike,
    tau: ArrayLike,
    class_ids: jax.Array | None = None,
    rule: str = "displacement",
) -> Graph:
    """The graphs of one padded demonstration, with activity. Frames from `length` on are fully masked.

    Args:
      objects: the object in each slot.
      boxes: (T, N, 4) float32.
      mask: (T, N) bool.
      length: number of real frames, 1 to T.
      tau, rule: see `update_activity`.
      class_ids: see `build_graph`.

    Returns:
      A graph whose fields have a leading time axis.
    """
    real = jnp.arange(mask.shape[0]) < length
    mask = mask & real[:, None]
    frames = jax.vmap(build_graph, in_axes=(None, 0, 0, 0, None))
    return frames(objects, boxes, mask, activity(boxes, mask, tau, rule), class_ids)


def safe_norm(vectors: jax.Array) -> jax.Array:
    """Euclidean norm over the last axis; its gradient at zero is zero, not NaN."""
    square = jnp.sum(vectors**2, axis=-1)
    return jnp.where(square > 0, jnp.sqrt(jnp.where(square > 0, square, 1.0)), 0.0)
