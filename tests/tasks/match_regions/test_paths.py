"""Shortest ways round blocks: straight where nothing is in the way, and round what is."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tasks.match_regions.paths import CLEARANCE, direction, distances, length_at

NOWHERE = jnp.full((1, 2), 9.0)
ROW = jnp.array([[0.0, y] for y in (-0.6, -0.3, 0.0, 0.3)])


def test_ways_in_an_empty_arena_are_straight():
    to = jnp.array([0.5, -0.3])
    lengths = distances(NOWHERE, to)
    points = jax.random.uniform(jax.random.key(0), (50, 2), minval=-0.7, maxval=0.7)
    straight = np.linalg.norm(points - to[None], axis=-1)
    # On a grid with diagonals, ways are up to 8 % longer than straight ones.
    found = np.asarray(length_at(lengths, points))
    assert (found >= straight - 0.05).all() and (found <= 1.09 * straight + 0.05).all()
    for point, length in zip(points, straight, strict=True):
        if length > 0.3:
            way = direction(lengths, point, to)
            cosine = way @ (to - point) / jnp.linalg.norm(way) / length
            assert cosine > 0.85


def test_a_row_of_blocks_is_gone_round():
    here, to = jnp.array([-0.6, -0.3]), jnp.array([0.6, -0.3])
    lengths = distances(ROW, to)
    around, through = (length_at(found, here[None])[0] for found in (lengths, distances(NOWHERE, to)))
    assert around > 1.5 * 1.2 > through
    nearest, place = [], here
    for _ in range(60):
        way = direction(lengths, place, to)
        place = place + 0.05 * way / jnp.linalg.norm(way)
        nearest.append(float(jnp.linalg.norm(ROW - place[None], axis=-1).min()))
        if jnp.linalg.norm(place - to) < 0.1:
            break
    assert jnp.linalg.norm(place - to) < 0.1 and min(nearest) > CLEARANCE - 0.1


def test_points_outside_the_arena_count_as_on_its_border():
    lengths = distances(NOWHERE, jnp.zeros(2))
    far, border = length_at(lengths, jnp.array([[3.0, 0.0], [0.8, 0.0]]))
    assert far == pytest.approx(float(border), abs=1e-2)
