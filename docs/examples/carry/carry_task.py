"""A task in a package of its own, as a user would write one: small enough that a whole run takes seconds.

A robot moves over a square image to a block. Once it touches the block, it carries it; the goal is a region.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from brax.envs.base import State

from graphrl_jax.demonstrations import Demonstrations, reached_for_good
from graphrl_jax.graph import ObjectTable
from graphrl_jax.reward.landscape import Grid, Landscape, Scenes
from graphrl_jax.task import Expert, Task

GOAL = np.array([0.8, 0.3], np.float32)
SPEED, TOUCH, SIZE = 0.08, 0.1, 0.1


class Places(NamedTuple):
    """Robot and block, (2,) each, in units of the image."""

    robot: jax.Array
    block: jax.Array


class Carry(Task):
    name = "carry"
    objects = ObjectTable(("region", "robot", "block"), (0, 1, 2), (False, True, False), ("region", "robot", "block"))
    event_names = ("placed",)
    episode_length = 30
    frame_rate = 10.0
    action_size = 2
    observation_size = 4

    def reset(self, rng: jax.Array) -> State:
        robot, block = jax.random.uniform(rng, (2, 2), minval=0.1, maxval=0.4)
        zero = jnp.zeros(())
        places = Places(robot, block)
        return State(places, jnp.concatenate(places), zero, zero, {"success": zero, "score": zero})

    def step(self, state: State, action: jax.Array) -> State:
        places = move(state.pipeline_state, action)
        distance = jnp.linalg.norm(places.block - GOAL)
        success = (distance < SIZE).astype(jnp.float32)
        metrics = {**state.metrics, "success": success, "score": success}
        return state.replace(pipeline_state=places, obs=jnp.concatenate(places), reward=-distance, metrics=metrics)

    def boxes(self, state: State) -> tuple[jax.Array, jax.Array]:
        return boxes(state.pipeline_state), jnp.ones(3, bool)

    def events(self, state: State) -> jax.Array:
        return jnp.linalg.norm(state.pipeline_state.block - GOAL, keepdims=True) < SIZE

    def training(self, starts: Any = None) -> "Carry":
        return self

    def image(self, physics: Places, size: int) -> jax.Array:
        return image(physics, size)

    def demonstrate(
        self, key: jax.Array, successes: int, failures: int = 0, image_size: int | None = None
    ) -> Demonstrations:
        kinds = np.arange(successes + failures) >= successes

        def episode(key: jax.Array, fails: jax.Array) -> Places:
            def step(places: Places, _: None) -> tuple[Places, Places]:
                action = jnp.where(fails, 0.0, way_to_goal(places))
                return move(places, action), places

            return jax.lax.scan(step, self.reset(key).pipeline_state, length=self.episode_length)[1]

        places = jax.jit(jax.vmap(episode))(jax.random.split(key, len(kinds)), kinds)
        placed = np.linalg.norm(np.asarray(places.block) - GOAL, axis=-1)[..., None] < SIZE
        return Demonstrations(
            boxes=np.asarray(jax.vmap(jax.vmap(boxes))(places)),
            mask=np.ones((*placed.shape[:2], 3), bool),
            lengths=np.full(len(kinds), self.episode_length, np.int32),
            success=~kinds,
            objects=self.objects,
            frame_rate=self.frame_rate,
            source="scripted",
            task=self.name,
            events=reached_for_good(placed),
            event_names=self.event_names,
            kinds=np.where(kinds, "idle", "success"),
            frames=None if image_size is None else _images(places, image_size),
        )

    def expert(self) -> Expert:
        return Expert(lambda state, key: (), lambda plan, state, key: (plan, way_to_goal(state.pipeline_state)))

    def landscape(self, key: jax.Array) -> Landscape:
        places = np.asarray(jax.random.uniform(key, (64, 2), minval=0.1, maxval=0.9))
        ticks = np.linspace(0.1, 0.9, 9, dtype=np.float32)
        grid = np.stack(np.meshgrid(ticks, ticks), -1)
        near = GOAL + np.linspace(-0.04, 0.04, 8, dtype=np.float32)[:, None]
        active = np.array([False, False, True])

        def scenes(blocks: np.ndarray) -> Scenes:
            places = Places(np.broadcast_to(np.float32(0.2), blocks.shape), blocks)
            seen = jnp.vectorize(lambda *both: boxes(Places(*both)), signature="(2),(2)->(n,m)")(*places)
            return Scenes(np.asarray(seen), active, places)

        corners = GOAL + SIZE * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
        inside = np.linalg.norm(grid - GOAL, axis=-1) < SIZE
        return Landscape(
            objects=self.objects,
            mask=np.ones(3, bool),
            grids=(Grid("block moved", scenes(grid), ticks, ticks, inside, corners, np.full(2, 0.2)),),
            random=scenes(places),
            random_distance=np.linalg.norm(places - GOAL, axis=-1),
            finished=scenes(near),
            unfinished=scenes(near - 0.4),
            within=scenes(near),
            beside=scenes(near + 1.2 * SIZE),
        )

    def draw_episode(
        self, states: Places, boxes: np.ndarray, mask: np.ndarray, active: np.ndarray, rewards: np.ndarray, label: str
    ) -> np.ndarray:
        frames = np.full((len(rewards), 64, 64, 3), 255, np.uint8)
        for frame, (x, y) in zip(frames, np.asarray(states.block), strict=True):
            row, column = (int(np.clip(64 * place, 2, 61)) for place in (y, x))
            frame[row - 2 : row + 3, column - 2 : column + 3] = (0, 128, 0)
        return frames


def way_to_goal(places: Places) -> jax.Array:
    """The expert's action (2,): to the block, and then to the goal; its length may be above 1."""
    carrying = jnp.linalg.norm(places.robot - places.block) < TOUCH
    return (jnp.where(carrying, GOAL, places.block) - places.robot) / SPEED


def move(places: Places, action: jax.Array) -> Places:
    """Moves the robot, and the block with it if it touches that."""
    way = SPEED * jnp.clip(action, -1.0, 1.0)
    touches = jnp.linalg.norm(places.robot - places.block) < TOUCH
    return Places(jnp.clip(places.robot + way, 0, 1), jnp.clip(places.block + touches * way, 0, 1))


def image(places: Places, size: int) -> jax.Array:
    """Region, robot and block as soft discs, one per colour channel: (size, size, 3)."""
    axis = (jnp.arange(size) + 0.5) / size
    x, y = jnp.stack([jnp.asarray(GOAL), *places]).T[:, None, None, :]
    square = (axis[None, :, None] - x) ** 2 + (axis[:, None, None] - y) ** 2
    return jnp.exp(-square / SIZE**2)


def _images(places: Places, size: int) -> np.ndarray:
    """Images of episodes, (B, T, size, size, 3) uint8."""
    drawn = jax.jit(jax.vmap(jax.vmap(lambda places: image(places, size))))(places)
    return np.asarray(jnp.round(255 * drawn), np.uint8)


def boxes(places: Places) -> jax.Array:
    """Boxes of region, robot and block: (3, 4)."""
    centres = jnp.stack([jnp.asarray(GOAL), *places])
    return jnp.concatenate([centres, jnp.full((3, 2), SIZE)], axis=-1)
