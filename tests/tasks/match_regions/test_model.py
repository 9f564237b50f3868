"""The physics in MuJoCo itself, without a compilation."""

import jax.numpy as jnp
import numpy as np
import pytest

from tasks.match_regions import geometry
from tasks.match_regions.model import FINGER_OPEN
from tests.helpers.match_regions import alone, simulate


def test_free_motion_has_magicals_speeds() -> None:
    forward = simulate(alone((0.0, -0.3, 0.0)), [(0.8, 0.0, False)] * 8)
    assert forward[1] - -0.3 == pytest.approx(0.8, abs=0.15)  # one second, less the time to gain speed
    assert abs(forward[0]) < 0.01
    turned = simulate(alone((0.0, 0.0, 0.0)), [(0.0, 2.5, False)] * 8)
    assert turned[2] == pytest.approx(2.5, abs=0.3)
    np.testing.assert_allclose(turned[:2], 0.0, atol=0.02)


def test_fingers_open_and_close_at_a_limited_rate() -> None:
    closed = simulate(alone((0.0, 0.0, 0.0)), [(0.0, 0.0, False)] * 8)
    np.testing.assert_allclose(closed[3:5], 0.0, atol=0.03)
    opening = closed
    opening = simulate(opening, [(0.0, 0.0, True)] * 2)
    assert 0.1 < opening[3] < 0.3  # 1 rad/s at most
    opened = simulate(opening, [(0.0, 0.0, True)] * 8)
    np.testing.assert_allclose(opened[3:5], [FINGER_OPEN, -FINGER_OPEN], atol=0.03)


def test_a_gripped_block_is_dragged_backwards_and_an_open_gripper_leaves_it() -> None:
    start = alone((0.0, 0.3, 0.0), (0.0, 0.625))
    close, back = [(0.0, 0.0, False)] * 3, 12
    dragged = simulate(start, close + [(-0.6, 0.0, False)] * back)
    left = simulate(start, [(-0.6, 0.0, True)] * (back + 3))
    assert dragged[6] < 0.625 - 0.4
    assert np.linalg.norm(dragged[5:7] - dragged[:2]) < 0.36
    assert left[6] > 0.6


def test_a_block_can_be_pulled_off_the_wall() -> None:
    start = alone((-0.53, 0.3, np.pi / 2), (-0.86, 0.3))
    dragged = simulate(start, [(0.2, 0.0, True)] * 2 + [(0.0, 0.0, False)] * 3 + [(-0.6, 0.0, False)] * 10)
    assert dragged[5] > -0.6


def test_a_pushed_block_comes_to_rest() -> None:
    pushed = simulate(alone((0.0, -0.2, 0.0), (0.0, 0.15)), [(0.8, 0.0, False)] * 6 + [(-0.6, 0.0, False)] * 4)
    later = simulate(pushed, [(0.0, 0.0, False)] * 1)
    rested = simulate(later, [(0.0, 0.0, False)] * 10)
    assert pushed[6] > 0.25
    np.testing.assert_allclose(rested[5:7], later[5:7], atol=0.02)


def test_walls_hold_robot_and_fingers() -> None:
    stopped = simulate(alone((0.0, 0.5, 0.0)), [(0.8, 0.0, False)] * 12)
    tips = geometry.finger_points(jnp.asarray(stopped[3:5], jnp.float32))[:, 2]
    height = stopped[1] + np.asarray(tips @ geometry.rotation(jnp.float32(stopped[2])).T)[:, 1]
    assert np.all(height < 1.0)
    assert stopped[1] > 0.55
