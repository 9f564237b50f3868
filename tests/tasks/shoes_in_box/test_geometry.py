"""Boxes against what MuJoCo's renderer sees."""

import jax
import mujoco
import numpy as np
import pytest

from tasks.shoes_in_box import geometry, layouts, model, render

BODIES = (("hand", "left_finger", "right_finger"), ("box",), ("lid",), ("shoe_1",), ("shoe_2",))


def random_scene(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """The arm near home, the lid anywhere, shoes lying or in the air."""
    random = np.random.default_rng(seed)
    qpos, box = (np.array(part) for part in layouts.Layout().sample(jax.random.key(seed)))
    qpos[:7] += random.uniform(-0.15, 0.15, 7)
    qpos[7:9] = random.uniform(0, model.FINGER_OPEN)
    qpos[9] = random.uniform(0, model.LID_OPEN)
    qpos[12], qpos[19] = random.uniform(0.01, 0.2, 2)
    turn = random.normal(size=4)
    qpos[13:17] = turn / np.linalg.norm(turn)
    return qpos, box


@pytest.mark.skipif(not render.can_render(), reason="no graphics library that MuJoCo can use")
def test_boxes_are_those_of_mujocos_segmentation():
    size = 480
    scene = render.build_model(model.Physics())
    data, renderer = mujoco.MjData(scene), mujoco.Renderer(scene, size, size)
    renderer.enable_segmentation_rendering()
    option = mujoco.MjvOption()
    option.geomgroup[:] = [1, 0, 0, 0, 0, 0]
    boxes = jax.jit(geometry.boxes)
    overlaps = []
    for seed in range(12):
        qpos, box = random_scene(seed)
        ours = np.asarray(boxes(qpos, box))
        render.pose_scene(scene, data, qpos, box)
        for node, bodies in enumerate(BODIES):
            # Everything else is hidden: objects are seen whole.
            scene.geom_group[:] = np.where(np.isin(scene.geom_bodyid, [scene.body(name).id for name in bodies]), 0, 5)
            renderer.update_scene(data, "front", option)
            rows, columns = np.nonzero(renderer.render()[..., 0] >= 0)
            low = np.array([columns.min(), rows.min()]) / size
            high = np.array([columns.max() + 1, rows.max() + 1]) / size
            corners = (ours[node, :2] - ours[node, 2:] / 2).clip(0, 1), (ours[node, :2] + ours[node, 2:] / 2).clip(0, 1)
            common = np.prod(np.clip(np.minimum(high, corners[1]) - np.maximum(low, corners[0]), 0, None))
            overlaps.append(common / (np.prod(high - low) + np.prod(corners[1] - corners[0]) - common))
    renderer.close()
    per_node = np.array(overlaps).reshape(-1, len(BODIES)).mean(0)
    assert np.all(per_node >= 0.95), per_node
