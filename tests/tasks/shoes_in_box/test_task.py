"""Shoes in Box as a task."""

import jax
import numpy as np
import pytest

from graphrl_jax.registry import make_task
from tasks.shoes_in_box import render


@pytest.mark.skipif(not render.can_render(), reason="no graphics library that MuJoCo can use")
def test_a_drawing_is_the_cameras_image_without_boxes():
    task = make_task("shoes_in_box")
    first, second = (jax.jit(task.reset)(jax.random.key(seed)).pipeline_state for seed in range(2))
    image = task.draw(first)
    np.testing.assert_array_equal(image, render.draw_scene(np.asarray(first.qpos), np.asarray(first.box), 320))
    assert image.shape == (320, 320, 3) and (image != task.draw(second)).any()
