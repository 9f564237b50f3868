"""Starts of training episodes, drawn from a made-up table whose every state has a number of its own."""

from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from graphrl_jax.encoder.pooling import PoolingParams
from graphrl_jax.rl.wrappers import EnvironmentReward
from tasks.shoes_in_box import kinematics
from tasks.shoes_in_box.model import INNER, LID_OPEN, SOLE
from tasks.shoes_in_box.objects import OBJECTS
from tasks.shoes_in_box.starts import TABLE, Mixture, Start, Starts, contacts_of, disturb, draw
from tasks.shoes_in_box.state import PhysicsState, shoes, shoes_inside
from tests.helpers.shoes_in_box import BOX, TASK, numbered_starts, repeated, scene

EPISODES, FRAMES = 3, 200
LENGTHS, CONTACTS = np.array([200, 150, 120]), np.array([[100, 110, 118]] * EPISODES)
DRAWS = 2000
LID, SHOES = OBJECTS.names.index("lid"), [OBJECTS.names.index("shoe_1"), OBJECTS.names.index("shoe_2")]
START = jax.jit(TASK.reset)(jax.random.key(0)).pipeline_state
BESIDE = scene(START, ((0.40, 0.33, 0.0), (0.40, -0.33, 0.3)))


@pytest.fixture(scope="module")
def table() -> Starts:
    return numbered_starts(BESIDE, LENGTHS, CONTACTS, FRAMES)


@partial(jax.jit, static_argnums=0)
def drawn(mixture: Mixture, table: Starts) -> Start:
    return jax.vmap(draw, in_axes=(0, None, None))(jax.random.split(jax.random.key(1), DRAWS), mixture, table)


def numbers(physics: PhysicsState) -> tuple[np.ndarray, np.ndarray]:
    """Episode and frame that states of the table are from."""
    return np.divmod(np.asarray(physics.frame).astype(int), 1000)


def test_contacts_are_the_first_frames_of_a_lifted_lid_and_of_touched_shoes():
    states = repeated(BESIDE, 8)
    touched = np.zeros((8, 2), bool)
    touched[[5, 6], 0], touched[2, 1] = True, True
    angles = jnp.array([0.0, 0.01, 0.04, 0.06, 0.0, 1.0, 2.0, 2.0])
    states = states._replace(qpos=states.qpos.at[:, 9].set(angles), touched=jnp.asarray(touched))
    found = contacts_of(states)
    assert found.dtype == np.int32
    np.testing.assert_array_equal(found, [3, 5, 2])


def test_only_states_of_the_table_are_drawn_and_none_from_past_an_episodes_end(table):
    start = drawn(Mixture(disturbed=0.0), table)
    episodes, frames = numbers(start.physics)
    assert set(episodes) == set(range(EPISODES)) and (frames < LENGTHS[episodes]).all()
    expected = jax.tree.map(lambda leaf: np.asarray(leaf)[episodes, frames], (table.states, table.active))
    jax.tree.map(np.testing.assert_array_equal, tuple(start), expected)


def test_half_of_the_starts_are_shortly_before_a_contact(table):
    def frames(before_contact: float) -> tuple[np.ndarray, np.ndarray]:
        return numbers(drawn(Mixture(disturbed=0.0, before_contact=before_contact), table).physics)

    # Uniform over an episode: its mean is the middle, and a quarter is in the last quarter.
    episodes, uniform = frames(0.0)
    share = (uniform + 0.5) / LENGTHS[episodes]
    assert abs(share.mean() - 0.5) < 0.02 and abs((share > 0.75).mean() - 0.25) < 0.03
    # 30 steps on average before one of three contacts, of an exponential distribution; frames are rounded down.
    _, before = frames(1.0)
    assert before.max() <= 118 and (before == 0).mean() < 0.08
    lead = CONTACTS[0].mean() - before.mean()
    assert abs(lead - 30.5 + 30 * np.exp(-CONTACTS[0] / 30).mean()) < 2.0
    # Past the last contact lie (200 - 118) / 200 of the first episode's states, and so on: a half of these remains.
    episodes, mixed = frames(0.5)
    past = np.maximum(LENGTHS - 118, 0) / LENGTHS
    assert abs((mixed > 118).mean() - past.mean() / 2) < 0.03


@pytest.mark.parametrize("share", [0.0, 0.2, 1.0])
def test_a_share_of_training_episodes_starts_from_the_layout(table, share):
    task = TASK.training(table)
    task.mixture = Mixture(from_start=share)
    states = jax.jit(jax.vmap(task.reset))(jax.random.split(jax.random.key(2), DRAWS))
    # Others have random frame numbers of 32 bits.
    from_table = np.asarray(states.pipeline_state.frame) < 10_000
    assert abs(from_table.mean() - (1 - share)) < 0.03
    assert not states.info["active"][~from_table].any() and (share == 1 or states.info["active"].any())
    assert np.isfinite(states.obs).all() and not states.done.any()


def test_a_task_without_starts_starts_from_its_layout():
    key = jax.random.key(5)
    one, other = jax.jit(TASK.reset)(key), jax.jit(TASK.training(None).reset)(key)
    jax.tree.map(np.testing.assert_array_equal, one, other)
    assert TASK.starts is None


def test_the_activity_of_a_start_is_carried_on(table):
    task = TASK.training(table)
    task.mixture = Mixture(from_start=0.0, disturbed=0.0)
    env = EnvironmentReward(task, PoolingParams())
    states = jax.jit(jax.vmap(env.reset))(jax.random.split(jax.random.key(3), 32))
    episodes, frames = numbers(states.pipeline_state)
    expected = np.asarray(table.active)[episodes, frames]
    assert expected.any() and not expected.all()
    np.testing.assert_array_equal(states.info["active"], expected)
    np.testing.assert_array_equal(states.obs[:, -5:], expected)
    # What has been active stays so, and the rest is compared with where it is at this start.
    np.testing.assert_array_equal(states.info["reference_boxes"], states.info["boxes"])
    after = jax.jit(jax.vmap(env.step))(states, jnp.zeros((32, 5)))
    assert (after.info["active"] >= expected).all()


@jax.jit
def disturbed(physics: PhysicsState, active: jax.Array) -> Start:
    return jax.vmap(disturb, in_axes=(0, None))(jax.random.split(jax.random.key(4), DRAWS), Start(physics, active))


NONE = jnp.zeros(5, bool)


def test_shoes_beside_the_box_are_moved_to_elsewhere_beside_it_and_count_as_moved():
    start = disturbed(BESIDE, NONE)
    lying, before = np.asarray(jax.vmap(shoes)(start.physics.qpos)), np.asarray(shoes(BESIDE.qpos))
    moved = (lying != before).any(-1)
    np.testing.assert_array_equal(start.active[:, SHOES], moved)
    assert not start.active[:, [slot for slot in range(5) if slot not in (LID, *SHOES)]].any()
    # A half, of those for which there is room on the drawn place.
    assert 0.05 < moved[:, 0].mean() < 0.5 and 0.05 < moved[:, 1].mean() < 0.5
    for shoe, side in ((0, 1.0), (1, -1.0)):
        x, y, z = lying[moved[:, shoe], shoe, :3].T
        assert (side * (y - BOX[1]) > INNER[1] + 0.1).all() and np.allclose(z, SOLE[2])
        assert (x >= TABLE[0][0]).all() and (x <= TABLE[1][0]).all() and (np.abs(y) <= TABLE[1][1]).all()
        assert np.ptp(x) > 0.2 and np.ptp(y) > 0.1
    assert not np.asarray(jax.vmap(shoes_inside)(start.physics)).any()


def test_nothing_but_shoes_and_lid_is_disturbed():
    start = disturbed(BESIDE, NONE)
    for name in PhysicsState._fields:
        found, expected = getattr(start.physics, name), getattr(BESIDE, name)
        if name == "qpos":
            found, expected = found[:, :9], expected[:9]
        np.testing.assert_array_equal(found, np.broadcast_to(expected, found.shape), err_msg=name)


def test_the_lid_is_turned_to_any_angle_in_a_quarter_of_the_cases():
    start = disturbed(BESIDE, NONE)
    angles = np.asarray(start.physics.qpos[:, 9])
    turned = angles != 0.0
    assert abs(turned.mean() - 0.25) < 0.03 and angles.min() >= 0 and angles.max() <= LID_OPEN
    assert abs(angles[turned].mean() - LID_OPEN / 2) < 0.1
    np.testing.assert_array_equal(start.active[:, LID], angles > 0.2)
    # An open lid that has been moved before counts as moved, wherever it is turned to.
    assert disturbed(BESIDE, NONE.at[LID].set(True)).active[:, LID].all()


def test_what_is_inside_or_near_the_gripper_is_left_alone():
    inside = scene(START, ((0.47, 0.07, 0.0), (0.40, -0.33, 0.3)), lid=LID_OPEN)
    assert list(np.asarray(shoes_inside(inside))) == [True, False]
    here = np.asarray(kinematics.pose(jnp.asarray(kinematics.HOME)))[:3]
    held = BESIDE._replace(qpos=BESIDE.qpos.at[10:13].set(here - np.array([0.0, 0.0, 0.03])))
    for physics, lid_stays in ((inside, True), (held, False)):
        start = disturbed(physics, NONE.at[LID].set(True))
        lying, before = np.asarray(jax.vmap(shoes)(start.physics.qpos)), np.asarray(shoes(physics.qpos))
        np.testing.assert_array_equal(lying[:, 0], np.broadcast_to(before[0], (DRAWS, 7)))
        assert (lying[:, 1] != before[1]).any(axis=-1).mean() > 0.05
        assert not start.active[:, SHOES[0]].any()
        assert lid_stays == bool((start.physics.qpos[:, 9] == physics.qpos[9]).all())


def test_mixtures_disturb_as_often_as_they_say(table):
    start = drawn(Mixture(disturbed=0.4), table)
    episodes, frames = numbers(start.physics)
    undisturbed = np.asarray(table.states.qpos)[episodes, frames]
    changed = (np.asarray(start.physics.qpos) != undisturbed).any(axis=1)
    all_of_them = drawn(replace(Mixture(), disturbed=1.0), table)
    most = (np.asarray(all_of_them.physics.qpos) != undisturbed).any(axis=1)
    assert abs(changed.mean() - 0.4 * most.mean()) < 0.04
