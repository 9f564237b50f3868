"""What is drawn shows where the objects are, who has moved, and how the reward went."""

from dataclasses import replace

import numpy as np
from PIL import Image, ImageDraw

from graphrl_jax.viz import drawing
from tests.helpers.demonstrations import demonstrations
from tests.helpers.graphs import OBJECTS

SIZE = 200
BOX = np.array([0.5, 0.3, 0.2, 0.1], np.float32)


def drawn(slot: int, active: bool) -> np.ndarray:
    """An image (SIZE, SIZE, 3) of one slot's box, the others masked."""
    image = Image.new("RGB", (SIZE, SIZE), drawing.PANEL)
    boxes, mask = np.tile(BOX, (4, 1)), np.arange(4) == slot
    drawing.draw_boxes(ImageDraw.Draw(image), SIZE, 2, boxes, mask, np.full(4, active), OBJECTS.is_robot)
    return np.asarray(image)


def colours(image: np.ndarray) -> set[tuple[int, ...]]:
    return {tuple(colour) for colour in image.reshape(-1, 3).tolist()}


def test_boxes_show_activity_and_mask():
    assert colours(drawn(1, True)) == {drawing.PANEL, drawing.ACTIVE_COLOUR}
    assert colours(drawn(1, False)) == {drawing.PANEL, drawing.IDLE_COLOUR}
    assert colours(drawn(0, True)) == {drawing.PANEL, drawing.ROBOT_BOX_COLOUR}
    assert colours(drawn(-1, True)) == {drawing.PANEL}


def test_a_box_lies_where_it_says_and_the_robots_is_broken():
    low, high = (BOX[:2] - BOX[2:] / 2) * SIZE, (BOX[:2] + BOX[2:] / 2) * SIZE
    shares = []
    for slot in (0, 1):
        rows, columns = np.nonzero(np.any(drawn(slot, False) != drawing.PANEL, axis=-1))
        np.testing.assert_allclose([columns.min(), rows.min()], low, atol=2)
        np.testing.assert_allclose([columns.max(), rows.max()], high, atol=2)
        edge = drawn(slot, False)[round(float(low[1])), round(float(low[0])) : round(float(high[0]))]
        shares.append(np.any(edge != drawing.PANEL, axis=-1).mean())
    assert shares[1] == 1.0 and 0.3 < shares[0] < 0.8


def test_without_mask_and_activity_every_box_is_there_and_idle():
    image = Image.new("RGB", (SIZE, SIZE), drawing.PANEL)
    boxes = np.stack([BOX, BOX + [0.0, 0.3, 0.0, 0.0], BOX + [0.0, 0.5, 0.0, 0.0]])
    drawing.draw_boxes(ImageDraw.Draw(image), SIZE, 2, boxes, None, None, (False,) * 3)
    pixels = np.asarray(image)
    assert colours(pixels) == {drawing.PANEL, drawing.IDLE_COLOUR}
    assert all(np.any(pixels[round(float(y - 0.05) * SIZE)] != drawing.PANEL) for y in boxes[:, 1])


def test_the_panel_shows_the_reward_so_far():
    panel = drawing.RewardPanel(np.linspace(-1, 0, 5), 128, "learned reward", 8.0)
    frames = np.stack([panel.draw(step) for step in range(5)])
    assert frames.shape == (5, 128, 128, 3) and frames.dtype == np.uint8
    green = np.sum(np.all(frames == drawing.CURVE, axis=-1), axis=(1, 2))
    assert np.all(np.diff(green) > 0)


def test_a_constant_reward_and_a_single_step_can_be_drawn():
    for rewards in (np.full(2, -1.0), np.zeros(1)):
        panel = drawing.RewardPanel(rewards, 64, "reward", 8.0)
        assert panel.draw(len(rewards) - 1).shape == (64, 64, 3)


def test_the_overlay_shows_names_and_boxes_of_what_is_there_and_what_has_moved():
    demos = demonstrations(num=1, num_frames=6)
    boxes = demos.boxes.copy()
    boxes[:, :, 0, 2:] = 0.1  # or the block's box would cover that of the robot that carries it
    demos = replace(demos, boxes=boxes, mask=demos.mask & (np.arange(4) != 2))
    frames = np.zeros((6, 96, 96, 3), np.uint8)
    seen = drawing.overlay(frames, demos, 0.02)
    # Small frames are drawn five times as large, so that names can be read.
    assert seen.shape == (6, 480, 480, 3) and seen.dtype == np.uint8 and not frames.any()
    # The robot walks, then carries the block; the region is masked.
    assert {drawing.ROBOT_BOX_COLOUR, drawing.IDLE_COLOUR} <= colours(seen[0])
    assert drawing.ACTIVE_COLOUR not in colours(seen[0])
    assert {drawing.ROBOT_BOX_COLOUR, drawing.ACTIVE_COLOUR} <= colours(seen[-1])
    assert drawing.IDLE_COLOUR not in colours(seen[-1])
    left, top = ((demos.boxes[0, 0, 1, :2] - demos.boxes[0, 0, 1, 2:] / 2) * 480).round().astype(int)
    assert tuple(seen[0, top, left]) == drawing.IDLE_COLOUR
    name = seen[0, top - 14 : top - 1, left : left + 40].reshape(-1, 3)
    assert (name == drawing.PANEL).all(1).any() and (name == drawing.IDLE_COLOUR).all(1).mean() > 0.4
    assert drawing.overlay(np.zeros((6, 500, 600, 3), np.uint8), demos, 0.02).shape == (6, 500, 600, 3)
