"""The environment: its interface, and how its detector sees."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from graphrl_jax.registry import make_task
from graphrl_jax.runtime import jit_physics
from tasks.detector_noise import DetectorNoise
from tasks.shoes_in_box import kinematics, layouts
from tasks.shoes_in_box.env import CLOSED, LEAST_OPEN, finger_target, grip_of
from tasks.shoes_in_box.model import FINGER_OPEN, LID_OPEN
from tasks.shoes_in_box.task import ShoesInBox
from tests.helpers.shoes_in_box import TASK


def test_a_poor_detector_hides_what_stands_behind_the_open_lid():
    shoes = (
        jnp.asarray(layouts.SHOE_STARTS)
        .at[:, :2]
        .set(layouts.BOX_START[None, :2] + np.array([[0.0, 0.07], [0.0, -0.07]]))
    )
    qpos = layouts.pack(jnp.asarray(kinematics.HOME), jnp.float32(LID_OPEN), shoes)
    start = TASK.reset(jax.random.key(0)).pipeline_state
    done = start._replace(qpos=qpos, box=jnp.asarray(layouts.BOX_START))
    perfect, mask = TASK.look(done)
    assert np.all(mask)
    boxes, mask = ShoesInBox(detector_noise=DetectorNoise(jitter=0.01, visible=0.9)).look(done)
    assert mask[2] and not mask[1] and not np.allclose(boxes, perfect)
    again, _ = ShoesInBox(detector_noise=DetectorNoise(jitter=0.01)).look(done._replace(frame=done.frame + 1))
    assert not np.allclose(boxes, again)


def test_the_task_is_registered_and_steps():
    task = make_task("shoes_in_box")
    state = task.reset(jax.random.key(0))
    assert state.obs.shape == (task.observation_size,) and np.isfinite(state.obs).all()
    boxes, mask = task.boxes(state)
    assert boxes.shape == (task.objects.num_slots, 4) and bool(mask.all())
    assert float(state.metrics["success"]) == 0.0 and not bool(task.events(state).any())


@pytest.mark.parametrize("before", [CLOSED, 0.021, FINGER_OPEN])
def test_fingers_close_open_or_stay_as_they_were(before):
    grips = {-1.0: CLOSED, -0.5: CLOSED, -0.49: before, 0.0: before, 0.49: before, 0.5: 0.02, 0.75: 0.03, 1.0: 0.04}
    for grip, expected in grips.items():
        np.testing.assert_allclose(finger_target(jnp.asarray(grip), jnp.asarray(before)), expected, atol=1e-6)


@pytest.mark.parametrize("before", [CLOSED, FINGER_OPEN])
def test_there_is_a_grip_for_every_command(before):
    commands = jnp.array([CLOSED, *np.linspace(LEAST_OPEN, FINGER_OPEN, 11)])
    grips = jax.vmap(grip_of)(commands)
    assert np.all((np.abs(grips) >= 0.5) & (np.abs(grips) <= 1))
    np.testing.assert_allclose(jax.vmap(finger_target, (0, None))(grips, jnp.asarray(before)), commands, atol=1e-6)


def test_a_command_of_the_fingers_is_kept_until_another_one():
    advance, state = jit_physics(TASK.advance), TASK.reset(jax.random.key(0)).pipeline_state
    assert float(state.finger) == pytest.approx(FINGER_OPEN)
    for grip, command in ((0.0, FINGER_OPEN), (-0.7, CLOSED), (0.3, CLOSED), (-0.3, CLOSED), (0.5, LEAST_OPEN)):
        state = advance(state, jnp.array([0.0, 0.0, 0.0, 0.0, grip]))
        assert float(state.finger) == pytest.approx(command)
    for _ in range(10):
        state = advance(state, jnp.zeros(5))
    np.testing.assert_allclose(state.qpos[7:9], LEAST_OPEN, atol=2e-3)
