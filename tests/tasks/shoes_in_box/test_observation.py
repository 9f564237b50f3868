"""What a policy sees, number by number."""

import jax
import jax.numpy as jnp
import numpy as np

from tasks.shoes_in_box import geometry, kinematics, layouts, observation
from tasks.shoes_in_box.model import FINGER_OPEN, LID_OPEN, SOLE
from tasks.shoes_in_box.observation import observe
from tasks.shoes_in_box.state import PhysicsState
from tests.helpers.shoes_in_box import TASK

BOX = np.array([0.45, 0.02, 0.3], np.float32)
START = jax.jit(TASK.reset)(jax.random.key(0))
HERE = np.asarray(kinematics.pose(jnp.asarray(kinematics.HOME)))
OBSERVE = jax.jit(observe)
SHOES = (slice(28, 41), slice(41, 54))
BAR, NEXT = slice(20, 25), slice(54, 59)


def arranged(places: list, lid: float, **changes: jax.Array) -> PhysicsState:
    """The arm at home; both shoes at (x, y, yaw) in the box's frame."""
    frame = geometry.box_pose(jnp.asarray(BOX))
    poses = [[*np.asarray(frame.place(jnp.array([x, y, 0.0])))[:2], yaw + BOX[2]] for x, y, yaw in places]
    qpos = layouts.pack(jnp.asarray(kinematics.HOME), jnp.asarray(lid), jnp.array(poses))
    return START.pipeline_state._replace(qpos=qpos, box=jnp.asarray(BOX), **changes)


def twice(angle: float) -> list[float]:
    return [np.sin(2 * angle), np.cos(2 * angle)]


def test_observation_has_its_documented_size_and_order():
    assert START.obs.shape == (TASK.observation_size,) == (observation.SIZE,) == (61,)
    finger, touched = jnp.asarray(0.03), jnp.array([False, True])
    rates = START.pipeline_state.qvel.at[9].set(0.7)
    places = [(0.05, 0.28, 0.2), (-0.02, -0.30, -0.5)]
    state = arranged(places, 0.5, finger=finger, touched=touched, qvel=rates)
    obs = np.asarray(OBSERVE(state))
    turn = np.array([[np.cos(BOX[2]), -np.sin(BOX[2])], [np.sin(BOX[2]), np.cos(BOX[2])]])
    middle = np.array([*BOX[:2], 0.0])
    local = [*((HERE[:2] - BOX[:2]) @ turn), HERE[2]]
    yaw = HERE[3] - BOX[2]
    np.testing.assert_allclose(obs[:5], [*local, np.sin(yaw), np.cos(yaw)], atol=1e-5)
    np.testing.assert_allclose(obs[5:7], 1.0, atol=1e-5)
    np.testing.assert_allclose(obs[7:14], kinematics.HOME, atol=1e-6)
    np.testing.assert_allclose(obs[14:18], [*BOX[:2], np.sin(BOX[2]), np.cos(BOX[2])], atol=1e-6)
    np.testing.assert_allclose(obs[18:20], [0.5 / LID_OPEN, 0.7], atol=1e-6)
    bar = np.asarray(geometry.bar(state.box, jnp.asarray(0.5)))
    np.testing.assert_allclose(obs[BAR], [*(bar - HERE[:3]), *twice(BOX[2] + np.pi / 2 - HERE[3])], atol=1e-5)
    np.testing.assert_allclose(obs[25:28], middle - HERE[:3], atol=1e-5)
    for (x, y, angle), touches, part in zip(places, (0, 1), SHOES, strict=True):
        place = np.array([*(BOX[:2] + turn @ [x, y]), SOLE[2]])
        grip = twice(BOX[2] + angle - HERE[3])
        expected = [x, y, SOLE[2], *(place - HERE[:3]), *twice(angle), *grip, 1, 0, touches]
        np.testing.assert_allclose(obs[part], expected, atol=1e-5)
    np.testing.assert_allclose(obs[59:], [0.0, 0.03 / FINGER_OPEN], atol=1e-6)


def test_what_comes_next_is_the_bar_then_the_nearest_shoe_outside_then_the_first_one():
    outside, inside = [(0.0, 0.33, 0.1), (0.0, -0.3, 0.4)], [(0.0, 0.07, 0.1), (0.0, -0.07, 0.4)]

    def seen(places: list, lid: float) -> np.ndarray:
        return np.asarray(OBSERVE(arranged(places, lid)))

    def grip(obs: np.ndarray, shoe: int) -> np.ndarray:
        return obs[SHOES[shoe]][[3, 4, 5, 8, 9]]

    shut = seen(outside, 0.0)
    np.testing.assert_array_equal(shut[NEXT], shut[BAR])
    for places in (outside, [outside[0], inside[1]], [inside[0], outside[1]], inside):
        obs = seen(places, LID_OPEN)
        free = [shoe for shoe in (0, 1) if not obs[SHOES[shoe]][11]]
        assert len(free) == sum(place in outside for place in places) and obs[59] == 1
        nearest = min(free, key=lambda shoe: np.linalg.norm(grip(obs, shoe)[:3]), default=0)
        np.testing.assert_array_equal(obs[NEXT], grip(obs, nearest))


def test_half_a_turn_of_a_shoe_is_the_same_grip_and_on_its_top_it_is_told_apart():
    places = [(0.0, 0.33, 0.1), (0.0, -0.3, 0.4)]
    obs = np.asarray(OBSERVE(arranged(places, 0.0)))
    turned = np.asarray(OBSERVE(arranged([(0.0, 0.33, 0.1 + np.pi), places[1]], 0.0)))
    np.testing.assert_allclose(turned, obs, atol=1e-5)
    state = arranged(places, 0.0)
    over = state._replace(qpos=state.qpos.at[13:17].set(jnp.array([0.0, 1.0, 0.0, 0.0])))
    np.testing.assert_allclose(np.asarray(OBSERVE(over))[[38, 51]], [-1.0, 1.0], atol=1e-6)
