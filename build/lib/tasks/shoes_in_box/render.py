"""Drawings of Shoes in Box through its camera, by MuJoCo's renderer, with the boxes and the reward beside it."""

import atexit
import warnings
from functools import cache
from typing import Any

import mujoco
import numpy as np
from PIL import Image, ImageDraw

from graphrl_jax.viz.drawing import PANEL, RewardPanel, draw_boxes
from tasks.shoes_in_box.model import CONTROL_DT, Physics, build_model
from tasks.shoes_in_box.objects import OBJECTS


@cache
def _renderer(size: int) -> tuple[mujoco.MjModel, mujoco.MjData, Any]:
    """Model, data and a renderer of `size` pixels square; the renderer is None if the machine cannot render."""
    model = build_model(Physics())
    try:
        renderer = mujoco.Renderer(model, size, size)
        atexit.register(renderer.close)  # before its library is unloaded
    except Exception as error:  # whatever the graphics library raises
        warnings.warn(f"MuJoCo cannot render here ({error}); drawings show boxes alone", stacklevel=2)
        renderer = None
    return model, mujoco.MjData(model), renderer


def can_render() -> bool:
    """Whether this machine has a graphics library that MuJoCo can use."""
    return _renderer(64)[2] is not None


def pose_scene(model: mujoco.MjModel, data: mujoco.MjData, qpos: np.ndarray, box: np.ndarray) -> None:
    """Sets the scene to `qpos` (24,) and the box's (x, y, yaw)."""
    body = model.body("box").id
    model.body_pos[body, :2] = box[:2]
    model.body_quat[body] = [np.cos(box[2] / 2), 0.0, 0.0, np.sin(box[2] / 2)]
    data.qpos[:] = qpos
    mujoco.mj_forward(model, data)


def draw_scene(
    qpos: np.ndarray,
    box: np.ndarray,
    size: int,
    boxes: np.ndarray | None = None,
    active: np.ndarray | None = None,
    shadows: bool = True,
) -> np.ndarray:
    """The camera's image (size, size, 3) uint8, with the objects' boxes (5, 4) if given.

    Args:
      qpos: (24,), see `state.PhysicsState`.
      box: (3,), x, y, yaw of the box.
      size: pixels along an edge.
      boxes: (5, 4) cx, cy, w, h in [0, 1]; active objects are orange, others grey, the gripper is dotted.
      active: (5,) bool.
      shadows: draws shadows and reflections, which takes eight times as long.
    """
    model, data, renderer = _renderer(size)
    if renderer is None:
        image = Image.new("RGB", (size, size), PANEL)
    else:
        pose_scene(model, data, qpos, box)
        renderer.update_scene(data, "front")
        for flag in (mujoco.mjtRndFlag.mjRND_SHADOW, mujoco.mjtRndFlag.mjRND_REFLECTION):
            renderer.scene.flags[flag] = shadows
        image = Image.fromarray(renderer.render())
    if boxes is not None:
        draw_boxes(ImageDraw.Draw(image), size, max(1, size // 200), boxes, None, active, OBJECTS.is_robot)
    return np.asarray(image)


def episode_frames(
    qpos: np.ndarray,
    box: np.ndarray,
    boxes: np.ndarray,
    active: np.ndarray,
    rewards: np.ndarray,
    label: str,
    size: int = 320,
) -> np.ndarray:
    """A video of one episode (T, size, 2 size, 3) uint8: the scene with its boxes, and the reward so far.

    Args:
      qpos, box: (T, 24) and (T, 3).
      boxes, active: (T, 5, 4) and (T, 5).
      rewards: (T,) finite.
      label: what the curve shows.
      size: pixels along an edge of each half.
    """
    panel = RewardPanel(rewards, size, label, 1 / CONTROL_DT)
    frames = [
        np.concatenate([draw_scene(qpos[t], box[t], size, boxes[t], active[t]), panel.draw(t)], axis=1)
        for t in range(len(qpos))
    ]
    return np.stack(frames)
