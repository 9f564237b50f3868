"""The environment: its interface, and how its detector sees."""

import jax
import jax.numpy as jnp
import numpy as np

from graphrl_jax.registry import make_task
from tasks.detector_noise import DetectorNoise
from tasks.shoes_in_box import kinematics, layouts
from tasks.shoes_in_box.model import LID_OPEN
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
