"""What was seen in a recording, drawn over its frames."""

import jax
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from graphrl_jax.demonstrations import Demonstrations
from graphrl_jax.drawing import ACTIVE_COLOUR, IDLE_COLOUR, ROBOT_BOX_COLOUR
from graphrl_jax.graph import activity


def overlay(frames: np.ndarray, demonstration: Demonstrations, tau: float) -> np.ndarray:
    """Frames (T, H, W, 3) uint8 with every object's box and slot; orange from when it has moved, the robot blue.

    Args:
      frames: (T, H, W, 3) uint8.
      demonstration: of the same frames, the only one in there.
      tau: activity threshold, see `graph.update_activity`.
    """
    boxes, mask = demonstration.boxes[0], demonstration.mask[0]
    active = np.asarray(jax.jit(activity)(boxes, mask, tau))
    height, width = frames.shape[1:3]
    scale = np.array([width, height])
    font = ImageFont.load_default(max(9, height // 32))
    objects = demonstration.objects
    drawn = []
    for frame, seen, moved, places in zip(frames, mask, active, boxes, strict=False):
        image = Image.fromarray(frame)
        draw = ImageDraw.Draw(image)
        for slot in np.flatnonzero(seen):
            colour = ROBOT_BOX_COLOUR if objects.is_robot[slot] else ACTIVE_COLOUR if moved[slot] else IDLE_COLOUR
            low = (places[slot, :2] - places[slot, 2:] / 2) * scale
            high = (places[slot, :2] + places[slot, 2:] / 2) * scale
            draw.rectangle([*low.tolist(), *(high - 1).tolist()], outline=colour, width=max(1, height // 250))
            draw.text((low[0] + 2, low[1] + 1), objects.names[slot], fill=colour, font=font)
        drawn.append(np.asarray(image))
    return np.stack(drawn)
