"""The rasteriser against the drawing for people, and against MAGICAL's own frames where those are at hand."""

import jax
import numpy as np
import pytest

from graphrl_jax.perception.importers.magical import frames_of, load_trajectory
from tasks.match_regions import layouts, raster, render
from tests.helpers.match_regions import DEMO, RECORDED

image = jax.jit(raster.image, static_argnums=2)


def at(poses: np.ndarray, fingers: tuple[float, float] = (0.3, -0.3)) -> np.ndarray:
    """`qpos` of robot and blocks at `poses` (1 + M, 3)."""
    return np.concatenate([poses[0], fingers, poses[1:].ravel()]).astype(np.float32)


def shrunk(drawn: np.ndarray, size: int) -> np.ndarray:
    """The mean colour of each of `size` x `size` patches, in [0, 1]."""
    side = drawn.shape[0] // size
    return drawn.reshape(size, side, size, side, 3).mean((1, 3)) / 255


def as_bytes(colour: np.ndarray) -> tuple[int, ...]:
    return tuple(int(round(255 * float(part))) for part in colour)


@pytest.fixture
def same_colours(monkeypatch):
    """The drawing for people, in the rasteriser's colours."""
    monkeypatch.setattr(render, "BACKGROUND", (255, 255, 255))
    monkeypatch.setattr(render, "INK", as_bytes(raster._WALL))
    monkeypatch.setattr(render, "BLOCK_COLOURS", tuple(map(as_bytes, raster._BLOCKS)))
    monkeypatch.setattr(render, "REGION_FILLS", tuple(map(as_bytes, raster._REGIONS)))
    monkeypatch.setattr(render, "ROBOT_COLOUR", as_bytes(raster._ROBOT))
    monkeypatch.setattr(render, "FINGER_COLOUR", as_bytes(raster._FINGER))


@pytest.mark.parametrize("seed", range(3))
def test_it_draws_what_the_drawing_for_people_shows(same_colours, seed):
    random = np.random.default_rng(seed)
    poses = random.uniform(-0.8, 0.8, (6, 3)) * [1, 1, np.pi]
    shapes = random.integers(0, 4, 5)
    world = DEMO._replace(shapes=shapes, colours=random.integers(0, 4, 5), present=np.arange(5) != 3)
    found = np.asarray(image(at(poses), jax.tree.map(np.asarray, world), 64))
    expected = shrunk(render.draw_scene(at(poses), world, 512), 64)
    difference = np.abs(found - expected).max(-1)
    # Left out here are the region's dashes and, there, the wall beyond the arena's border.
    west, east, south, north = DEMO.region
    x = (np.arange(64) + 0.5) / 64 * 2.04 - 1.02
    beside = [np.abs(x - edge) < 0.05 for edge in (west, east)], [np.abs(-x - edge) < 0.05 for edge in (south, north)]
    lines = (beside[0][0] | beside[0][1])[None, :] | (beside[1][0] | beside[1][1])[:, None]
    border = np.maximum(np.abs(x)[None, :], np.abs(x)[:, None]) > 0.95
    counted = ~(lines | border)
    assert difference[counted].mean() < 0.005 and (difference[counted] > 0.12).mean() < 0.01
    # So does the neighbourhood of every body alone, of which another shape changes a tenth at least.
    for body in poses:
        near = counted & (np.hypot(x[None, :] - body[0], -x[:, None] - body[1]) < 0.2)
        assert (difference[near] > 0.12).mean() < 0.04


def test_blocks_that_are_not_there_are_not_drawn():
    poses = np.concatenate([layouts.ROBOT_START[None], layouts.BLOCK_STARTS])
    world = jax.tree.map(np.asarray, DEMO)
    row, column = int((1.02 - poses[1, 1]) / 2.04 * 64), int((poses[1, 0] + 1.02) / 2.04 * 64)
    shown = image(at(poses), world, 64)[row, column]
    np.testing.assert_allclose(shown, raster._BLOCKS[layouts.GREEN], atol=1e-6)
    gone = image(at(poses), world._replace(present=world.present & (np.arange(5) != 0)), 64)[row, column]
    np.testing.assert_allclose(gone, 1.0)


@pytest.mark.skipif(not RECORDED.exists(), reason="MAGICAL's demonstrations are not here")
def test_it_draws_what_magical_drew():
    path = RECORDED / "demo-MatchRegions-Demo-v0-000.pkl.gz"
    frames = frames_of(load_trajectory(path), path)
    with np.load(RECORDED / "truth.npz") as truth:
        states, fingers = truth["states"][0], truth["rel_finger_angles"][0]
    world = jax.tree.map(np.asarray, DEMO)
    for index in (0, 40, 90):
        poses = np.concatenate([states[index, :3], states[index, 9:]]).reshape(-1, 3)
        found = np.asarray(image(at(poses, fingers[index]), world, 64))
        difference = np.abs(found - shrunk(frames[index], 64))
        # What is left is the robot's eyes, and thin lines.
        assert difference.mean() < 0.01 and (difference.max(-1) > 0.15).mean() < 0.005
