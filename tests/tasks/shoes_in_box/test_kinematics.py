"""The arm's kinematics against MuJoCo's."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

from tasks.shoes_in_box import kinematics, model
from tests.helpers.shoes_in_box import TASK


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
