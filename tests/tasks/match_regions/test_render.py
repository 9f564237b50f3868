"""The drawn scene agrees with the boxes and poses it was drawn from."""

import jax
import numpy as np
import pytest

from graphrl_jax.viz import drawing
from tasks.match_regions import geometry, layouts, render
from tasks.match_regions.objects import OBJECTS
from tests.helpers.match_regions import DEMO

SIZE = 256
STAR_BOX_SLOT, ROBOT_SLOT = 2, 1


def scene(**places: tuple[float, float, float]) -> np.ndarray:
    """`qpos` (20,) of the demonstration layout, robot or blocks (`block_0`, ...) moved as asked."""
    poses = np.concatenate([layouts.ROBOT_START[None], layouts.BLOCK_STARTS])
    for name, pose in places.items():
        poses[0 if name == "robot" else 1 + int(name[-1])] = pose
    return np.concatenate([poses[0], [0.3, -0.3], poses[1:].ravel()]).astype(np.float32)


def repeated(frames: int) -> layouts.World:
    """The demonstration scene at every frame."""
    return layouts.World(*(np.stack([leaf] * frames) for leaf in DEMO))


def pixel(x: float, y: float) -> tuple[int, int]:
    """Row and column of an arena point."""
    return int((1.02 - y) * SIZE / 2.04), int((x + 1.02) * SIZE / 2.04)


def changed_pixels(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Columns and rows (P, 2) where two images differ."""
    return np.argwhere(np.any(before != after, axis=-1))[:, ::-1]


def assert_tight(pixels: np.ndarray, box: np.ndarray) -> None:
    """`pixels` (P, 2) fill the image-normalised box (4,), up to a pixel at the edges."""
    low, high = (box[:2] - box[2:] / 2) * SIZE, (box[:2] + box[2:] / 2) * SIZE
    np.testing.assert_allclose(pixels.min(0), low, atol=1.6)
    np.testing.assert_allclose(pixels.max(0) + 1, high, atol=1.6)


def test_every_block_has_its_colour_at_its_centre() -> None:
    image = render.draw_scene(scene(), DEMO, SIZE)
    assert image.shape == (SIZE, SIZE, 3) and image.dtype == np.uint8
    for pose, colour in zip(layouts.BLOCK_STARTS, DEMO.colours, strict=True):
        assert tuple(image[pixel(pose[0], pose[1])]) == render.BLOCK_COLOURS[colour]
    assert tuple(image[pixel(*layouts.ROBOT_START[:2])]) == render.ROBOT_COLOUR
    assert tuple(image[pixel(0.4, 0.35)]) == render.REGION_FILLS[layouts.GREEN]
    assert tuple(image[pixel(-0.1, 0.9)]) == render.BACKGROUND


@pytest.mark.parametrize("block", range(5))
@pytest.mark.parametrize("theta", [0.0, 0.7, -2.5])
def test_drawn_block_fills_its_box(block: int, theta: float) -> None:
    place, elsewhere = (-0.2, 0.5, theta), (0.85, 0.85, 0.0)
    drawn = render.draw_scene(scene(**{f"block_{block}": place}), DEMO, SIZE)
    without = render.draw_scene(scene(**{f"block_{block}": elsewhere}), DEMO, SIZE)
    pixels = changed_pixels(without, drawn)
    pixels = pixels[pixels[:, 0] < 0.7 * SIZE]  # the others are those of the block elsewhere
    poses = layouts.BLOCK_STARTS.copy()
    poses[block] = place
    with jax.disable_jit():
        box = np.asarray(geometry.block_boxes(poses, DEMO.shapes))[block]
    assert_tight(pixels, box)


@pytest.mark.parametrize("theta", [0.0, 1.1, -2.0])
def test_drawn_robot_fills_its_box(theta: float) -> None:
    blocks_away = {f"block_{i}": (-0.8 + 0.4 * i, -0.85, 0.0) for i in range(5)}
    drawn = render.draw_scene(scene(robot=(-0.4, 0.2, theta), **blocks_away), DEMO, SIZE)
    without = render.draw_scene(scene(robot=(5.0, 5.0, 0.0), **blocks_away), DEMO, SIZE)
    with jax.disable_jit():
        box = np.asarray(geometry.robot_box(np.array([-0.4, 0.2, theta]), np.array([0.3, -0.3])))
    assert_tight(changed_pixels(without, drawn), box)


def test_fingers_agree_with_the_geometry_on_device() -> None:
    fingers = np.array([0.3, -0.1], np.float32)
    with jax.disable_jit():
        expected = geometry.finger_points(fingers)
    np.testing.assert_allclose(render.finger_lines(fingers), expected, atol=1e-6)


def test_boxes_show_activity_and_mask() -> None:
    boxes = np.tile(np.array([0.5, 0.1, 0.1, 0.1], np.float32), (OBJECTS.num_slots, 1))
    edge = round(0.1 * SIZE), round(0.45 * SIZE)

    def edge_colours(slot: int, active: bool) -> set[tuple[int, ...]]:
        mask = np.arange(OBJECTS.num_slots) == slot
        image = render.draw_scene(scene(), DEMO, SIZE, boxes, mask, np.full(OBJECTS.num_slots, active))
        rows = image[edge[0] - 8 : edge[0] + 8, edge[1] - 1 : edge[1] + 2]
        return {tuple(colour) for colour in rows.reshape(-1, 3).tolist()}

    assert drawing.ACTIVE_COLOUR in edge_colours(STAR_BOX_SLOT, True)
    assert drawing.IDLE_COLOUR in edge_colours(STAR_BOX_SLOT, False)
    dotted = edge_colours(ROBOT_SLOT, True)
    assert {drawing.ROBOT_BOX_COLOUR, render.BACKGROUND} <= dotted
    assert edge_colours(-1, True) == {render.BACKGROUND}


def test_episode_frames_show_the_reward_so_far() -> None:
    steps, slots = 5, OBJECTS.num_slots
    qpos = np.tile(scene(), (steps, 1))
    boxes, mask = np.full((steps, slots, 4), 0.2, np.float32), np.zeros((steps, slots), bool)
    rewards = np.linspace(-1, 0, steps)
    frames = render.episode_frames(qpos, repeated(steps), boxes, mask, mask, rewards, SIZE, "learned reward")
    assert frames.shape == (steps, SIZE, 2 * SIZE, 3) and frames.dtype == np.uint8
    np.testing.assert_array_equal(frames[:, :, :SIZE], np.broadcast_to(frames[0, :, :SIZE], (steps, SIZE, SIZE, 3)))
    green = np.sum(np.all(frames[:, :, SIZE:] == drawing.CURVE, axis=-1), axis=(1, 2))
    assert np.all(np.diff(green) > 0)


def test_a_constant_reward_can_be_drawn() -> None:
    qpos, empty = np.tile(scene(), (2, 1)), np.zeros((2, OBJECTS.num_slots), bool)
    boxes = np.zeros((2, OBJECTS.num_slots, 4), np.float32)
    frames = render.episode_frames(qpos, repeated(len(qpos)), boxes, empty, empty, np.full(2, -1.0), 64, "reward")
    assert frames.shape == (2, 64, 128, 3)
