"""Starts of training episodes, drawn from a made-up table whose every state has a number of its own."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from graphrl_jax.encoder.pooling import PoolingParams
from graphrl_jax.rl.wrappers import EnvironmentReward
from tasks.shoes_in_box import kinematics, starts
from tasks.shoes_in_box.model import INNER, LID_OPEN, SOLE
from tasks.shoes_in_box.objects import OBJECTS
from tasks.shoes_in_box.starts import TABLE, Curriculum, Mixture, Start, Starts, adapt, begin, disturb, draw, ends_of
from tasks.shoes_in_box.state import PhysicsState, shoes, shoes_inside
from tests.helpers.shoes_in_box import BOX, TASK, numbered_starts, scene

EPISODES, FRAMES = 3, 200
ENDS = np.array([[50, 100, 200], [40, 90, 150], [100, 110, 120]])
DRAWS = 2000
LID, SHOES = OBJECTS.names.index("lid"), [OBJECTS.names.index("shoe_1"), OBJECTS.names.index("shoe_2")]
START = jax.jit(TASK.reset)(jax.random.key(0)).pipeline_state
BESIDE = scene(START, ((0.40, 0.33, 0.0), (0.40, -0.33, 0.3)))


FIRST = Start(BESIDE._replace(frame=jnp.uint32(999_999)), jnp.zeros(5, bool))


@pytest.fixture(scope="module")
def table() -> Starts:
    return numbered_starts(BESIDE, ENDS, FRAMES + 1)


def leads(*values: float) -> Curriculum:
    return begin(Mixture())._replace(leads=jnp.array(values))


@partial(jax.jit, static_argnums=0)
def drawn(mixture: Mixture, table: Starts, curriculum: Curriculum) -> tuple[Start, Curriculum]:
    each = jax.vmap(draw, in_axes=(0, None, None, None, None))
    return each(jax.random.split(jax.random.key(1), DRAWS), mixture, table, curriculum, FIRST)


def numbers(physics: PhysicsState) -> tuple[np.ndarray, np.ndarray]:
    """Episode and frame that states of the table are from."""
    return np.divmod(np.asarray(physics.frame).astype(int), 1000)


def test_jobs_end_when_they_stay_done():
    inside, outside = (0.47, 0.07, 0.0), (0.40, 0.33, 0.0)
    states = [
        scene(START, (first, second), lid)
        for first, second, lid in (
            (outside, outside, 0.0),
            (outside, outside, 2.0),  # the lid falls shut again
            (outside, outside, 1.0),
            (outside, outside, 2.0),
            (outside, inside, 2.0),
            ((0.47, -0.07, 0.0), inside, 2.0),
        )
    ]
    episode = jax.tree.map(lambda *leaves: jnp.stack(leaves), *states)
    found = ends_of(episode)
    assert found.dtype == np.int32
    np.testing.assert_array_equal(found, [3, 4, 5])


def test_only_states_of_the_table_are_drawn(table):
    start, _ = drawn(Mixture(from_start=0.0, disturbed=0.0), table, leads(0.9, 0.9, 0.9))
    episodes, frames = numbers(start.physics)
    assert set(episodes) == set(range(EPISODES))
    expected = jax.tree.map(lambda leaf: np.asarray(leaf)[episodes, frames], (table.states, table.active))
    jax.tree.map(np.testing.assert_array_equal, tuple(start), expected)


def test_starts_are_at_most_a_lead_before_the_end_of_their_job_and_mostly_far_from_it(table):
    wanted = np.array([0.2, 0.5, 0.9])
    start, curriculum = drawn(Mixture(from_start=0.0, disturbed=0.0), table, leads(*wanted))
    episodes, frames = numbers(start.physics)
    job = np.asarray(curriculum.job)
    begins = np.concatenate([np.zeros((EPISODES, 1), int), ENDS], axis=1)[episodes, job]
    length = ENDS[episodes, job] - begins
    share = (ENDS[episodes, job] - frames) / length / wanted[job]
    assert (np.bincount(job) > 0.3 * DRAWS).all()
    assert (share >= 0).all() and (share <= 1 + 0.5 / length / wanted[job]).all()
    # The density grows in proportion to the distance from the end; frames are whole.
    assert abs(share.mean() - 2 / 3) < 0.02 and abs((share > 0.5).mean() - 0.75) < 0.04


def test_a_start_with_the_whole_lid_left_is_the_layouts(table):
    start, curriculum = drawn(Mixture(from_start=0.0, disturbed=0.0), table, leads(1.0, 0.5, 0.5))
    first = np.asarray(start.physics.frame) == 999_999
    assert 0 < first.mean() < 0.1 and (np.asarray(curriculum.job)[first] == 0).all()
    assert not start.active[first].any()


@pytest.mark.parametrize("share", [0.0, 0.2, 1.0])
def test_a_share_of_starts_is_the_layouts(table, share):
    start, curriculum = drawn(Mixture(from_start=share, disturbed=0.0), table, leads(0.5, 0.5, 0.5))
    first = np.asarray(start.physics.frame) == 999_999
    assert abs(first.mean() - share) < 0.03
    np.testing.assert_array_equal(np.asarray(curriculum.job) == -1, first)


MIXTURE = Mixture(growth=2.0, success=0.75)


@pytest.mark.parametrize(
    ("job", "done", "expected"),
    [
        (0, 1, [0.4, 0.2, 0.2]),
        (0, 0, [0.05, 0.2, 0.2]),  # 0.2 / 2^3, but not below the least
        (2, 3, [0.2, 0.2, 0.4]),
        (2, 2, [0.2, 0.2, 0.05]),
        (-1, 3, [0.2, 0.2, 0.2]),
        (-1, 0, [0.2, 0.2, 0.2]),
    ],
)
def test_a_lead_grows_after_a_success_and_shrinks_after_a_failure(monkeypatch, job, done, expected):
    monkeypatch.setattr(starts, "jobs_done", lambda state: state)
    curriculum = Curriculum(jnp.full(3, 0.2), jnp.asarray(job))
    found = adapt(curriculum, MIXTURE, jnp.asarray(done))
    np.testing.assert_allclose(found.leads, expected, rtol=1e-5)
    assert found.job == job


def test_a_lead_stays_at_the_wanted_share_of_successes_and_never_exceeds_the_job(monkeypatch):
    monkeypatch.setattr(starts, "jobs_done", lambda state: state)
    curriculum = Curriculum(jnp.full(3, 0.4), jnp.asarray(0))
    for done in (1, 1, 0, 1):  # three of four; the second is capped at 1
        curriculum = adapt(curriculum, MIXTURE, jnp.asarray(done))
    np.testing.assert_allclose(curriculum.leads, [0.25, 0.4, 0.4], rtol=1e-5)


def test_an_environment_keeps_its_curriculum_from_one_episode_to_the_next(table):
    task = TASK.training(table)
    state = jax.jit(task.reset)(jax.random.key(2))
    np.testing.assert_allclose(state.info["curriculum"].leads, 0.25)
    assert state.metrics["lead"] == 0.25
    opened = scene(START, ((0.40, 0.33, 0.0), (0.40, -0.33, 0.0)), lid=2.0)
    last = state.replace(pipeline_state=opened, info={"curriculum": Curriculum(jnp.full(3, 0.25), jnp.asarray(0))})
    after = jax.jit(task.restart)(jax.random.key(3), last)
    np.testing.assert_allclose(after.info["curriculum"].leads, [0.4, 0.25, 0.25], rtol=1e-6)
    # The metric is that of the running episode; automatic resets keep the metrics of the finished one.
    stale = after.replace(metrics=state.metrics)
    assert jax.jit(task.step)(stale, jnp.zeros(5)).metrics["lead"] == pytest.approx(0.3)
    assert np.isfinite(after.obs).all() and not after.done


def test_a_task_without_starts_starts_from_its_layout():
    key = jax.random.key(5)
    one, other = jax.jit(TASK.reset)(key), jax.jit(TASK.training(None).reset)(key)
    jax.tree.map(np.testing.assert_array_equal, one, other)
    assert TASK.starts is None


def test_the_activity_of_a_start_is_carried_on(table):
    task = TASK.training(table)
    task.mixture = Mixture(from_start=0.0, disturbed=0.0, first_lead=0.9)
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
    assert abs(moved[:, 0].mean() - 0.5) < 0.05 and abs(moved[:, 1].mean() - 0.5) < 0.05
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
    start, _ = drawn(Mixture(from_start=0.0, disturbed=0.4), table, leads(0.9, 0.9, 0.9))
    episodes, frames = numbers(start.physics)
    undisturbed = np.asarray(table.states.qpos)[episodes, frames]
    changed = (np.asarray(start.physics.qpos) != undisturbed).any(axis=1)
    all_of_them, curriculum = drawn(Mixture(from_start=0.0, disturbed=1.0), table, leads(0.9, 0.9, 0.9))
    most = (np.asarray(all_of_them.physics.qpos) != undisturbed).any(axis=1)
    assert abs(changed.mean() - 0.4 * most.mean()) < 0.04 and most.mean() > 0.5
    assert (curriculum.job == -1).all()
