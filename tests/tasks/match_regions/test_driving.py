"""Driving, by hand: commands that move a held block, and ways to places beside a block."""

import jax.numpy as jnp
import numpy as np
import pytest

from tasks.match_regions import driving, geometry
from tasks.match_regions.env import BACKWARD_SPEED, FORWARD_SPEED
from tasks.match_regions.observation import TURN_RATE
from tasks.match_regions.paths import distances

EAST = jnp.array([1.0, 0.0])
NOWHERE = jnp.full((1, 2), 9.0)


@pytest.mark.parametrize("angle", np.linspace(-3.0, 3.0, 9))
def test_a_held_block_moves_along_its_way_whichever_way_the_robot_faces(angle):
    way = jnp.array([np.cos(angle), np.sin(angle)], jnp.float32)
    speed, turn = np.asarray(driving.carry(EAST, way, jnp.float32(1.0)))
    # What the command does to a point that lies 0.33 ahead of a robot that faces east.
    pace = speed * (FORWARD_SPEED if speed > 0 else BACKWARD_SPEED)
    velocity = np.array([pace, 0.33 * turn * TURN_RATE])
    np.testing.assert_allclose(velocity / np.linalg.norm(velocity), way, atol=1e-5)
    assert max(abs(speed), abs(turn)) <= 1.0 and np.linalg.norm(velocity) > 0.55


def test_a_near_place_behind_is_reached_backwards_and_a_far_one_ahead_forwards():
    robot, ahead = jnp.zeros(8), geometry.heading(jnp.float32(0.0))
    for place, sign in ((-0.3, -1), (0.7, 1)):
        speed, turn = driving.go_to(robot, place * ahead, place * ahead, ahead)
        assert np.sign(speed) == sign and abs(turn) < 1e-5


def test_a_block_is_gripped_from_where_the_robot_is_unless_a_wall_is_there():
    goal, aside = jnp.array([0.0, -0.7]), jnp.float32(0.0)
    block, robot = jnp.array([0.2, 0.3]), jnp.array([-0.6, 0.3])
    side = driving.quickest_side(distances(NOWHERE, robot), robot, block, goal, aside)
    assert side[0] < -0.7
    corner, robot = jnp.array([-0.8, 0.8]), jnp.array([-0.75, 0.2])
    side = driving.quickest_side(distances(NOWHERE, robot), robot, corner, goal, aside)
    standoff = corner + driving.STANDOFF * side
    np.testing.assert_allclose(driving.within(standoff), standoff, atol=0.03)
