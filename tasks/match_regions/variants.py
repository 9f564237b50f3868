"""MAGICAL's variants of Match Regions, as reset distributions of one compiled environment.

Eight block slots hold up to two targets of the region's colour and up to two distractors of each other colour. Variants
change array values only: shapes and colours are classes, counts are a mask, forces are fields of the model. All
variants and mixtures of them therefore run in one program. The Demo scene alone is faster in `task.MatchRegions()`.
"""

import math
from dataclasses import dataclass
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from graphrl_jax.task import TrainingSize
from tasks.match_regions import geometry, layouts
from tasks.match_regions.layouts import GREEN, NUM_TARGETS, Start, World
from tasks.match_regions.model import ARENA_HALF
from tasks.match_regions.task import MatchRegions

BLOCKS = 8
# For each of the six distractor slots: index among the three other colours, and the least number of blocks of that
# colour that fills the slot. The first three slots are the Demo scene's, which has none, one and two blocks of the
# other colours in order.
_OTHER_COLOUR = np.array([1, 2, 2, 0, 0, 1])
_FILLED_FROM = np.array([1, 1, 2, 1, 2, 2])
_DEMO_COUNTS = np.array([0, 1, 2])
# Shapes of the Demo scene; slots that it leaves empty have any shape.
_SHAPES = layouts.demo_world(BLOCKS).shapes
# Uniform ranges of MAGICAL's dynamics, as factors on its defaults; see `layouts.World.strengths`.
_WEAKEST = np.array([2.2 / 3, 0.7, 2.5 / 4, 1.0 / 1.5, 0.7], np.float32)
_STRONGEST = np.array([3.5 / 3, 1.5, 4.5 / 4, 1.8 / 1.5, 1.5], np.float32)
_REGION_SIDES = 0.5, 0.8
# MAGICAL's jitter to either side: 2.5 % of half the arena's side, 5 % of half a turn, 2.5 % of the range of sides.
_JITTER, _TURN, _SIDE_JITTER = 0.025, 0.05 * math.pi, 0.0075
# Jitter of poses in all other variants: enough that no two episodes are equal, far less than MAGICAL's jitter.
_NUDGE = 0.005
# Empty slots lie beside the arena, one unit apart.
_PARKED = np.stack([3.0 + np.arange(BLOCKS), np.full(BLOCKS, 3.0), np.zeros(BLOCKS)], axis=-1).astype(np.float32)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Variant:
    """Properties that differ between episodes; every field is a bool, or a traced () bool array.

    | field    | meaning                                                                                       |
    |----------|-----------------------------------------------------------------------------------------------|
    | jitter   | small changes of poses and of the region's place and sides                                    |
    | colour   | colour of the targets and the region                                                          |
    | shape    | shape of every block                                                                          |
    | layout   | robot, blocks and region anywhere, clear of each other; sides of the region from 0.5 to 0.8   |
    | count    | one or two targets, none to two distractors of each other colour; needs layout                |
    | dynamics | forces of the robot and friction under blocks                                                 |
    """

    jitter: ArrayLike = False
    colour: ArrayLike = False
    shape: ArrayLike = False
    layout: ArrayLike = False
    count: ArrayLike = False
    dynamics: ArrayLike = False

    @property
    def blocks(self) -> int:
        return BLOCKS

    @property
    def fixed(self) -> bool:
        return False

    def sample(self, key: jax.Array) -> Start:
        """A random start."""
        blocks_key, region_key, scatter_key, pose_key, force_key = jax.random.split(key, 5)
        colour, colours, shapes, present = self._blocks(blocks_key)
        region = self._region(region_key)
        factors = jax.random.uniform(force_key, (5,), minval=_WEAKEST, maxval=_STRONGEST)
        strengths = jnp.where(self.dynamics, factors, 1.0)
        world = World(region, colour, colours, shapes, present, strengths)

        starts = jnp.concatenate([layouts.ROBOT_START[None], layouts.BLOCK_STARTS, _PARKED[:3]])
        shift, turn = jnp.where(self.jitter, _JITTER, _NUDGE), jnp.where(self.jitter, _TURN, _NUDGE)
        placed = layouts.jittered(pose_key, starts, shift, turn)
        poses = jnp.where(self.layout, layouts.scatter(scatter_key, present, region), placed)
        empty = jnp.append(False, ~present)[:, None]
        return layouts.begin(jnp.where(empty, jnp.concatenate([starts[:1], _PARKED]), poses), world)

    def _blocks(self, key: jax.Array) -> tuple[jax.Array, jax.Array, jax.Array, jax.Array]:
        """Colour () of region and targets; colours, shapes and presence of all blocks, (8,) each."""
        colour_key, shape_key, target_key, count_key = jax.random.split(key, 4)
        colour = jnp.where(self.colour, jax.random.randint(colour_key, (), 0, len(layouts.COLOURS)), GREEN)
        others = _OTHER_COLOUR + (_OTHER_COLOUR >= colour)  # the k-th colour that is not the targets'
        colours = jnp.concatenate([jnp.full(NUM_TARGETS, colour), others])
        shapes = jax.random.randint(shape_key, (BLOCKS,), 0, len(geometry.SHAPES))
        targets = jnp.where(self.count, jax.random.randint(target_key, (), 1, NUM_TARGETS + 1), NUM_TARGETS)
        counts = jnp.where(self.count, jax.random.randint(count_key, (3,), 0, 3), _DEMO_COUNTS)
        present = [jnp.arange(NUM_TARGETS) < targets, counts[_OTHER_COLOUR] >= _FILLED_FROM]
        return colour, colours, jnp.where(self.shape, shapes, _SHAPES), jnp.concatenate(present)

    def _region(self, key: jax.Array) -> jax.Array:
        """The goal region: (4,)."""
        side_key, place_key = jax.random.split(key)
        demo = jnp.array(geometry.REGION)
        low, high = geometry.region_corners(demo)
        sides, centre = high - low, (low + high) / 2
        unit = jax.random.uniform(side_key, (2,), minval=-1.0, maxval=1.0)
        smallest, largest = _REGION_SIDES
        drawn = (smallest + largest) / 2 + unit * (largest - smallest) / 2
        sides = jnp.where(self.layout, drawn, sides + jnp.where(self.jitter, _SIDE_JITTER, 0.0) * unit)
        unit = jax.random.uniform(place_key, (2,), minval=-1.0, maxval=1.0)
        jittered = centre + jnp.where(self.jitter, _JITTER, 0.0) * unit
        centre = jnp.where(self.layout, unit * (ARENA_HALF - sides / 2), jittered)
        low, high = centre - sides / 2, centre + sides / 2
        return jnp.stack([low[0], high[0], low[1], high[1]])


VARIANTS = {
    "demo": Variant(),
    "jitter": Variant(jitter=True),
    "colour": Variant(colour=True),
    "shape": Variant(shape=True),
    "layout": Variant(layout=True),
    "count": Variant(layout=True, count=True, dynamics=True),
    "count_plus": Variant(colour=True, shape=True, layout=True, count=True),
    "dynamics": Variant(dynamics=True),
    "all": Variant(colour=True, shape=True, layout=True, count=True, dynamics=True),
}
"""Variants by name, combined as in MAGICAL; it lacks `count`, which is `all` in the Demo scene's colours and shapes.

Policies observe neither, so those trained on `count` can be judged on `all`. Encoders do observe them, and do not learn
from demonstrations of `all` which colours belong together.
"""


# Where everything is anywhere, distractors lie in the way, and going around them takes longer to learn. Success still
# rises over the last third of the updates, as the learning rate falls.
_WHERE_ANYWHERE = {
    "activation": "swish",
    "policy_hidden": (256, 256),
    "value_hidden": (256, 256),
    "final_learning_rate": 5e-5,
}
_SIZES_ANYWHERE = {"cpu": TrainingSize(1500, _WHERE_ANYWHERE), "gpu": TrainingSize(600, _WHERE_ANYWHERE)}


def make(name: str, engine: str | None = None) -> MatchRegions:
    """The task with the starts of one of `VARIANTS`; registered as `match_regions_<name>`."""
    task = MatchRegions(VARIANTS[name], engine=engine)
    task.name = f"match_regions_{name}"
    if VARIANTS[name].layout:
        task.training_sizes = _SIZES_ANYWHERE
    if VARIANTS[name].count:
        # At 0.01, one of two encoders still had all frames at one point after 1000 steps.
        task.pretrain_overrides = {**task.pretrain_overrides, "temperature": 0.001}
    return task


demo, jitter, colour, shape, layout, count, count_plus, dynamics, everything = (
    partial(make, name) for name in VARIANTS
)
