"""Shoes in Box: kinematics and boxes against MuJoCo, the interface, and the expert."""

import math

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

from graphrl_jax.task import make_task
from tasks.detection import Detector
from tasks.shoes_in_box import env, expert, geometry, kinematics, layouts, model, render

TASK = env.ShoesInBox()
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


def test_forward_kinematics_are_mujocos():
    forward = jax.jit(kinematics.forward)
    data = mujoco.MjData(TASK.mj_model)
    for seed in range(5):
        joints = np.random.default_rng(seed).uniform(*np.array(model.JOINT_RANGES).T)
        data.qpos[:7] = joints
        mujoco.mj_forward(TASK.mj_model, data)
        hand = data.body("hand")
        rotation = hand.xmat.reshape(3, 3)
        tip, found, _, _ = forward(joints.astype(np.float32))
        np.testing.assert_allclose(tip, hand.xpos + model.TCP_DISTANCE * rotation[:, 2], atol=1e-5)
        np.testing.assert_allclose(found, rotation, atol=1e-5)


@pytest.mark.parametrize("target", [(0.31, 0.0, 0.08, 1.6), (0.66, 0.05, 0.32, 1.2), (0.4, 0.36, 0.04, -0.4)])
def test_differential_kinematics_reach_a_pose_pointing_down(target):
    @jax.jit
    def reach(joints):
        return jax.lax.scan(lambda q, _: (kinematics.approach(q, jnp.array(target)), None), joints, length=80)[0]

    joints = reach(jnp.asarray(kinematics.HOME))
    np.testing.assert_allclose(kinematics.pose(joints), target, atol=2e-3)
    assert kinematics.forward(joints)[1][2, 2] < -0.9999
    low, high = np.array(model.JOINT_RANGES).T
    assert np.all((joints > low) & (joints < high))


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


def test_starts_are_randomised_as_in_rlbench():
    qpos, boxes = jax.vmap(TASK.layout.sample)(jax.random.split(jax.random.key(0), 256))
    assert np.all(np.abs(boxes[:, 2]) <= math.pi / 8) and np.std(boxes[:, 2]) > 0.15
    shoes = np.asarray(qpos[:, 10:]).reshape(-1, 2, 7)
    assert np.all(np.abs(shoes[..., :2] - layouts.SHOE_STARTS[:, :2]) <= 0.03 + 1e-6)
    np.testing.assert_allclose(np.linalg.norm(shoes[..., 3:], axis=-1), 1.0, atol=1e-6)


@pytest.fixture(scope="module")
def rollouts():
    """Two successes and a failure of every kind."""
    kinds = np.array([0, 0, *range(1, len(expert.FAILURES) + 1)])
    states, busy = jax.tree.map(np.asarray, expert.rollouts(TASK, jax.random.key(3), kinds))
    return states, busy, kinds


def last(states) -> env.PhysicsState:
    return jax.tree.map(lambda leaf: leaf[:, -1], states)


def test_the_expert_succeeds_and_failures_fail(rollouts):
    states, busy, kinds = rollouts
    assert np.isfinite(states.qpos).all()
    solved = np.asarray(jax.vmap(env.success)(last(states)))
    assert solved[kinds == 0].all() and not solved[kinds > 0].any()
    assert np.all(busy > TASK.episode_length / 2)


def test_plans_of_failures_differ_in_what_goes_wrong_and_whether_it_is_tried_again():
    draw = jax.vmap(expert.draw_plan, in_axes=(0, None))
    for kind, name in enumerate(("success", *expert.FAILURES)):
        plans = draw(jax.random.split(jax.random.key(kind), 200), kind)
        found = {tuple(wrong) for wrong in np.asarray(plans.wrong).tolist()}
        lid, first, second, both = (True, False, False), (False, True, False), (False, False, True), (False, True, True)
        shoes = {first, second} if name == "one_shoe" else {first, second, both}
        assert found == ({(False,) * 3} if name == "success" else {lid} if name.startswith("lid") else shoes), name
        assert (0.3 < np.mean(plans.persists) < 0.7) != (name == "one_shoe"), name


def test_demonstrations_and_failures_have_the_same_lengths(monkeypatch, rollouts):
    states, busy, kinds = rollouts
    plenty = np.resize(np.arange(len(kinds)), 64)
    many = jax.tree.map(lambda leaf: leaf[plenty], states)
    done = busy[plenty] + np.arange(64) % 7

    def solved_before(task, key, wanted):
        order = np.array([np.flatnonzero(kinds[plenty] == kind)[i % 8] for i, kind in enumerate(wanted)])
        return jax.tree.map(lambda leaf: leaf[order], many), done[order]

    monkeypatch.setattr(expert, "rollouts", solved_before)
    demos = TASK.demonstrate(jax.random.key(0), 30, 30)
    assert demos.success.sum() == 30 and set(demos.kinds[30:]) == set(expert.FAILURES)
    assert set(demos.lengths[30:]) <= set(demos.lengths[:30]) and demos.lengths.min() > TASK.episode_length / 2
    assert abs(demos.lengths[30:].mean() - demos.lengths[:30].mean()) < 10
    assert (demos.events[demos.success] > 0).all()


def test_a_poor_detector_hides_what_stands_behind_the_open_lid(rollouts):
    states, _, kinds = rollouts
    done = jax.tree.map(lambda leaf: leaf[0, -1], states)
    perfect, mask = TASK.look(done)
    assert np.all(mask)
    boxes, mask = env.ShoesInBox(detector=Detector(jitter=0.01, visible=0.9)).look(done)
    assert mask[2] and not mask[1] and not np.allclose(boxes, perfect)
    again, _ = env.ShoesInBox(detector=Detector(jitter=0.01)).look(done._replace(frame=done.frame + 1))
    assert not np.allclose(boxes, again)


def test_failures_fail_by_what_they_are_named_for(rollouts):
    states, _, kinds = rollouts
    inside = np.asarray(jax.vmap(env.shoes_inside)(last(states)))
    opened = np.asarray(jax.vmap(env.lid_is_open)(last(states)))
    for kind, name in enumerate(expert.FAILURES, start=1):
        index = int(np.flatnonzero(kinds == kind)[0])
        if name.startswith("lid"):
            assert not opened[index] and not inside[index].any(), name
        else:
            assert opened[index] and not inside[index].all(), name


def test_a_carried_shoe_is_touched_and_its_events_come_in_order(rollouts):
    states, _, _ = rollouts
    solved = int(np.flatnonzero(np.asarray(jax.vmap(env.success)(last(states))))[0])
    single = jax.tree.map(lambda leaf: leaf[solved], states)
    height = single.qpos[:, [12, 19]]
    lifted = height > 0.12
    assert lifted.any(0).all() and (single.touched[lifted]).mean() > 0.95
    events = np.asarray(jax.vmap(env.events)(single))
    first = events.argmax(0)
    assert events[-1].all() and 0 < first[0] < first[1:].min() and not single.touched[first[1:], [0, 1]].any()
    assert np.asarray(jax.vmap(env.score)(single))[-1] == pytest.approx(1.0)


def test_the_task_is_registered_and_steps():
    task = make_task("shoes_in_box")
    state = task.reset(jax.random.key(0))
    assert state.obs.shape == (task.observation_size,) and np.isfinite(state.obs).all()
    boxes, mask = task.boxes(state)
    assert boxes.shape == (task.objects.num_slots, 4) and bool(mask.all())
    assert float(state.metrics["success"]) == 0.0 and not bool(task.events(state).any())


def test_the_landscapes_scenes_are_what_they_say():
    found = TASK.landscape(jax.random.key(0))
    assert len(found.grids) == 4 and all(grid.inside.any() and not grid.inside.all() for grid in found.grids)
    assert np.ptp(found.random_distance) > 0.5 and np.isfinite(found.random.boxes).all()
    for scenes in (found.finished, found.unfinished, found.within, found.beside):
        boxes = scenes.boxes
        assert np.all((boxes[..., 2:] > 0) & (boxes[..., :2] > -0.5) & (boxes[..., :2] < 1.5))
