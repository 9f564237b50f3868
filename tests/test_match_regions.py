"""The task: geometry against recorded truth, physics in MuJoCo itself (no compilation), scoring and reward by hand."""

import os
from pathlib import Path

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

from graphrl_jax.compilation import jit_physics
from graphrl_jax.wrappers import EnvironmentReward
from tasks.match_regions import env, geometry, layouts, magical
from tasks.match_regions.expert import FAILURES
from tasks.match_regions.model import CONTROL_DT, DRIVEN_MASS, FAITHFUL, FINGER_OPEN, Physics, build_model
from tasks.match_regions.observation import observe
from tasks.match_regions.reward import REACH_PER_TARGET, Reward, environment_reward
from tasks.match_regions.state import PhysicsState, boxes, grasp_point, score

TRUTH = Path(os.environ.get("GRAPHRL_DATA", Path(__file__).parents[2] / "shared" / "data"))
TRUTH = TRUTH / "magical_match_regions" / "truth.npz"
DEMO = layouts.demo_scene()


def demo_qpos() -> np.ndarray:
    poses = np.concatenate([layouts.ROBOT_START, [FINGER_OPEN, -FINGER_OPEN], layouts.BLOCK_STARTS.ravel()])
    return poses.astype(np.float32)


def placed(qpos: np.ndarray, block: int, x: float, y: float) -> np.ndarray:
    qpos = qpos.copy()
    qpos[5 + 3 * block : 7 + 3 * block] = x, y
    return qpos


# Iterations enough for the solver to converge.
SOLVED = Physics(iterations=20, ls_iterations=20)


def simulate(qpos: np.ndarray, commands: list[tuple[float, float, bool]], physics: Physics = SOLVED) -> np.ndarray:
    """Plays (speed in units/s, turn in rad/s, open) commands, one per control step, in MuJoCo: final qpos (20,)."""
    model = build_model(physics)
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    for speed, turn, is_open in commands:
        opening = FINGER_OPEN if is_open else 0.0
        for _ in range(physics.substeps):
            rates = np.clip((np.array([opening, -opening]) - data.qpos[3:5]) * 10, -1, 1)
            heading = np.array([-np.sin(data.qpos[2]), np.cos(data.qpos[2])])
            # The force that drives it is limited along its direction, and positions lag (see `Physics`).
            change = speed * heading - data.qvel[:2]
            most = physics.drive_force / DRIVEN_MASS * physics.timestep
            drive = data.qvel[:2] + change * min(1.0, most / max(np.linalg.norm(change), 1e-6))
            data.ctrl[:] = [*drive, turn, *rates]
            before = data.qvel.copy()
            mujoco.mj_step(model, data)
            data.qpos[:] -= physics.lag * physics.timestep * (data.qvel - before)
    return data.qpos.copy()


def alone(robot: tuple[float, float, float], block: tuple[float, float] | None = None) -> np.ndarray:
    """The robot at a pose, the star at `block`, and everything else out of the way along the southern wall."""
    qpos = demo_qpos()
    qpos[:3] = robot
    for index, x in enumerate((-0.8, -0.4, 0.0, 0.4, 0.8)):
        qpos = placed(qpos, index, x, -0.85)
    return qpos if block is None else placed(qpos, 0, *block)


@pytest.mark.skipif(not TRUTH.exists(), reason="recorded demonstrations are not on this machine")
def test_boxes_match_the_recorded_ones() -> None:
    truth = np.load(TRUTH)
    states = truth["states"][:, ::10].reshape(-1, 24).astype(np.float32)
    fingers = truth["rel_finger_angles"][:, ::10].reshape(-1, 2).astype(np.float32)
    recorded = truth["boxes"][:, ::10].reshape(-1, 7, 4)
    qpos = np.concatenate([states[:, :3], fingers, states[:, 9:]], axis=1)
    found = np.asarray(jax.jit(jax.vmap(lambda qpos: boxes(qpos, DEMO)[0]))(qpos))
    corners = np.concatenate([found[..., :2] - found[..., 2:] / 2, found[..., :2] + found[..., 2:] / 2], -1)
    ours = corners[:, [2, 3, 4, 5, 6, 0, 1]]
    low = np.maximum(ours[..., :2], recorded[..., :2])
    high = np.minimum(ours[..., 2:], recorded[..., 2:])
    overlap = np.prod(np.maximum(high - low, 0), -1)
    area = np.prod(ours[..., 2:] - ours[..., :2], -1) + np.prod(recorded[..., 2:] - recorded[..., :2], -1)
    iou = (overlap / (area - overlap)).mean(0)
    assert np.all(iou[:6] > 0.99), iou
    assert iou[6] > 0.95, iou


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


@pytest.mark.parametrize(
    ("inside", "expected"),
    [((), 0.0), ((0,), 0.5), ((0, 1), 1.0), ((0, 1, 2), 2 / 3), ((2,), 0.0), ((0, 2, 3), 0.5 / 3)],
)
def test_score_is_magicals(inside: tuple[int, ...], expected: float) -> None:
    qpos = demo_qpos()
    for i, block in enumerate(inside):
        qpos = placed(qpos, block, 0.2 + 0.15 * i, 0.3)
    assert float(score(jnp.asarray(qpos), DEMO)) == pytest.approx(expected)


def test_environment_reward_by_hand() -> None:
    task = env.MatchRegions(reward=Reward(reach=0.0))
    state = task.reset(jax.random.key(0)).pipeline_state
    qpos = placed(placed(np.array(state.qpos), 0, 0.4, 0.35), 1, -0.2, 0.35)
    moved = state._replace(qpos=jnp.asarray(qpos))
    # The star is inside: distance 0. The square is 0.6 from the centre (0.4, 0.35). No distractor is inside.
    potential = float(state.initial_distance.sum()) - 0.6 - 0.1
    expected = 10 * np.tanh(potential / 2)
    assert float(environment_reward(moved, task.reward)) == pytest.approx(expected, abs=1e-4)


def reach_term(qpos: np.ndarray) -> float:
    """What the reach term takes from the potential p at a coefficient of 0.25, divided by it."""
    state = env.MatchRegions().reset(jax.random.key(0)).pipeline_state
    state = state._replace(qpos=jnp.asarray(qpos))
    rewards = [float(environment_reward(state, Reward(reach=reach))) / 10 for reach in (0.0, 0.25)]
    return 2 * (np.arctanh(rewards[0]) - np.arctanh(rewards[1])) / 0.25


def test_reach_term_by_hand() -> None:
    none_placed = demo_qpos()
    grasp = np.asarray(grasp_point(none_placed))
    to_star, to_square = (np.hypot(*(place - grasp)) for place in (none_placed[5:7], none_placed[8:10]))
    assert reach_term(none_placed) == pytest.approx(min(to_star, to_square) + REACH_PER_TARGET, abs=0.01)
    star_placed = placed(none_placed, 0, 0.4, 0.35)
    assert reach_term(star_placed) == pytest.approx(to_square, abs=0.01)
    assert reach_term(placed(star_placed, 1, 0.3, 0.3)) == pytest.approx(0.0, abs=0.01)


@pytest.mark.parametrize(
    "physics, tolerance", [pytest.param(SOLVED, 0.01, id="solved"), pytest.param(Physics(), 0.03, id="default")]
)
def test_mjx_moves_as_mujoco_does(physics, tolerance) -> None:
    """Free motion, gripping, dragging and letting go; with the default's one iteration nearly so."""
    task = env.MatchRegions(physics=physics)
    start = alone((0.0, 0.3, 0.0), (0.05, 0.625))
    commands = [(0.0, 0.0, False)] * 3 + [(-0.6, 0.5, False)] * 5 + [(0.0, 0.0, True)] * 2 + [(-0.6, 0.0, True)] * 4
    state = task.reset(jax.random.key(0)).pipeline_state
    state = state._replace(qpos=jnp.asarray(start))
    advance = jit_physics(task.advance)
    for speed, turn, is_open in commands:
        share = speed / (env.FORWARD_SPEED if speed > 0 else env.BACKWARD_SPEED)
        state = advance(state, jnp.array([share, turn / env.TURN_RATE, 1.0 if is_open else -1.0]))
    found, expected = np.asarray(state.qpos), simulate(start, commands)
    assert np.linalg.norm(expected[5:7] - start[5:7]) > 0.2
    np.testing.assert_allclose(found, expected, atol=tolerance)


def test_expert_demonstrates_successes_and_every_kind_of_failure() -> None:
    demos = env.MatchRegions().demonstrate(jax.random.key(0), successes=6, failures=7)
    assert list(demos.kinds) == ["success"] * 6 + list(FAILURES)
    assert demos.success.tolist() == [True] * 6 + [False] * 7
    both = demos.events[:, list(demos.event_names).index("both_placed")]
    assert (both[:6] > 0).all() and (both[:6] < demos.lengths[:6]).all() and (both[6:] == -1).all()
    assert (demos.lengths[:6] < 121).sum() >= 3 and demos.lengths[-1] == 121
    star_first = demos.events[:6, 0] < demos.events[:6, 1]
    assert 0 < star_first.sum() < 6


def test_edge_scenes_differ_in_one_target_that_crosses_the_border() -> None:
    scenes = env.MatchRegions().landscape(jax.random.key(0))
    inside, outside = scenes.within.boxes, scenes.beside.boxes
    region = inside[0, 0]
    reach = region[2:] / 2
    within, beside = ((np.abs(boxes[:, 2:4, :2] - region[:2]) <= reach).all(-1) for boxes in (inside, outside))
    assert within.all() and (beside.sum(1) == 1).all() and 0.3 < beside[:, 0].mean() < 0.7
    np.testing.assert_array_equal(inside[:, 4:], outside[:, 4:])
    active = scenes.within.active
    np.testing.assert_array_equal(active, scenes.beside.active)
    assert not active[:, [0, 7]].any() and active[:, 1:4].all()
    assert 0.3 < active[:, 4:7].mean() < 0.7
    # The robot stands outside and reaches in: it touches the target that crosses, and faces the region.
    gap = np.linalg.norm(outside[:, 1, :2] - outside[:, 2:4, :2][~beside], axis=-1)
    assert gap.max() < 0.25


def test_demo_layout_is_the_recorded_one_up_to_its_jitter() -> None:
    qpos = jax.jit(jax.vmap(layouts.Demo(jitter=0.03).sample))(jax.random.split(jax.random.key(1), 64)).qpos
    offset = np.asarray(qpos[:, 5:].reshape(64, 5, 3)) - layouts.BLOCK_STARTS
    assert np.abs(offset).max() <= 0.03
    assert np.abs(offset).max() > 0.02
    assert not np.allclose(qpos[0], qpos[1])


@pytest.mark.parametrize("layout", [layouts.Demo(jitter=0.5), layouts.Training(layouts.Demo())])
def test_every_layout_stays_inside_the_walls(layout: layouts.Layout) -> None:
    qpos = np.asarray(jax.jit(jax.vmap(layout.sample))(jax.random.split(jax.random.key(2), 256)).qpos)
    assert np.isfinite(qpos).all()
    assert np.abs(qpos[:, :2]).max() <= 0.8
    assert np.abs(qpos[:, 5:].reshape(-1, 5, 3)[..., :2]).max() <= 0.9
    assert np.abs(qpos[:, 3:5]).max() <= FINGER_OPEN + 1e-6


def test_training_starts_cover_placed_and_held_targets() -> None:
    qpos = jax.jit(jax.vmap(layouts.Training(layouts.Demo()).sample))(jax.random.split(jax.random.key(3), 512)).qpos
    targets = np.asarray(qpos[:, 5:11].reshape(-1, 2, 3)[..., :2])
    inside = np.asarray(geometry.inside_region(DEMO.region, jnp.asarray(targets)))
    assert 0.1 < inside.mean() < 0.4
    held = np.linalg.norm(targets - np.asarray(jax.vmap(grasp_point)(qpos))[:, None], axis=-1).min(1) < 0.02
    assert 0.05 < held.mean() < 0.4


def test_observation_has_its_documented_size_and_frame() -> None:
    task = env.MatchRegions()
    state = task.reset(jax.random.key(0))
    assert state.obs.shape == (task.observation_size,)
    qpos = alone((0.1, 0.2, 0.7))
    ahead = np.array([-np.sin(0.7), np.cos(0.7)])
    qpos = placed(qpos, 0, *(np.array([0.1, 0.2]) + 0.4 * ahead))
    obs = np.asarray(observe(state.pipeline_state._replace(qpos=jnp.asarray(qpos, jnp.float32))))
    np.testing.assert_allclose(obs[13:15], [0.3, 0.35], atol=1e-5)  # the region's half sides
    np.testing.assert_allclose(obs[15:17], [0.4, 0.0], atol=1e-5)  # the star: 0.4 ahead, 0 to the left
    np.testing.assert_allclose(obs[22:25], [0.4, 1.0, 0.0], atol=1e-5)
    np.testing.assert_array_equal(obs[[21, 32, 37]], [0, 0, 1])


def test_distractors_are_seen_nearest_first() -> None:
    qpos = placed(placed(alone((0.0, 0.0, 0.0)), 4, 0.0, 0.5), 2, 0.3, 0.6)
    state = PhysicsState(jnp.asarray(qpos), jnp.zeros(20), jnp.zeros(20), jnp.ones(2), DEMO)
    obs = np.asarray(observe(state))[38:].reshape(3, 7)
    # The robot faces up: ahead is y, left is minus x.
    np.testing.assert_allclose(obs[:, :2], [[0.5, 0.0], [0.6, -0.3], [-0.85, -0.4]], atol=1e-5)
    np.testing.assert_array_equal(obs[:, 6], [0, 1, 0])


@pytest.mark.parametrize(
    "star, square, star_first",
    [
        pytest.param((-0.3, 0.0), (0.0, -0.6), True, id="nearer"),
        pytest.param((-0.9, 0.0), (0.0, -0.6), False, id="farther"),
        pytest.param((-0.9, 0.0), (0.3, 0.3), True, id="farther, the other placed"),
        pytest.param((0.6, 0.6), (0.3, 0.3), False, id="both placed"),
    ],
)
def test_the_target_to_see_to_comes_first(star, square, star_first) -> None:
    qpos = placed(placed(alone((0.0, 0.0, 0.0)), 0, *star), 1, *square)
    state = PhysicsState(jnp.asarray(qpos), jnp.zeros(20), jnp.zeros(20), jnp.array([1.0, 2.0]), DEMO)
    obs = np.asarray(observe(state))
    # The robot faces up: ahead is y, left is minus x.
    rows = [[y, -x] for x, y in (star, square)]
    np.testing.assert_allclose(obs[[15, 16, 26, 27]], np.ravel(rows if star_first else rows[::-1]), atol=1e-5)
    assert obs[37] == star_first and obs[25] == (1.0 if star_first else 2.0)
    in_slots = np.asarray(observe(state, targets_in_order=False))
    np.testing.assert_allclose(in_slots[[15, 16, 26, 27]], np.ravel(rows), atol=1e-5)
    np.testing.assert_array_equal(np.delete(in_slots, np.s_[15:38]), np.delete(obs, np.s_[15:38]))


def test_training_keeps_what_the_task_was_told() -> None:
    task = env.MatchRegions(targets_in_order=False, varied=0.25).with_reward(reach=0.5).training()
    assert task.layout == layouts.Training(layouts.Demo(), 0.25)
    assert (task.targets_in_order, task.reward.reach) == (False, 0.5)


def test_a_target_that_starts_in_its_place_counts_as_moved():
    class Placed(layouts.Demo):
        def sample(self, key):
            start = layouts.Demo(jitter=0.0).sample(key)
            moved = jnp.array([False, False, True, False, False])
            return start._replace(qpos=jnp.asarray(placed(demo_qpos(), 1, 0.4, 0.3)), moved=moved)

    for layout, flags in ((layouts.Demo(), [0, 0, 0]), (Placed(), [0, 1, 1])):
        state = jax.jit(EnvironmentReward(env.MatchRegions(layout), 0.02).reset)(jax.random.key(0))
        np.testing.assert_array_equal(state.info["active"][2:5], flags)
        np.testing.assert_array_equal(state.info["active"][jnp.array([0, 1, 5, 6, 7])], False)
        # It counts as brought from where the layout had it.
        homes = layouts.BLOCK_STARTS[:2, :2] - np.asarray(geometry.region_centre(DEMO.region))
        found = state.pipeline_state.initial_distance
        np.testing.assert_allclose(found, np.linalg.norm(homes, axis=-1), atol=0.05)


def test_training_bumps_distractors_in_some_episodes() -> None:
    layout, keys = layouts.Training(layouts.Demo(jitter=0.0)), jax.random.split(jax.random.key(4), 512)
    qpos, moved = (np.asarray(part) for part in jax.jit(jax.vmap(layout.sample))(keys)[:2])
    away = np.linalg.norm(qpos[:, 5:].reshape(-1, 5, 3)[..., :2] - layouts.BLOCK_STARTS[:, :2], axis=-1) > 1e-6
    assert not moved[:, :2].any()
    np.testing.assert_array_equal(moved[:, 2:], away[:, 2:])
    assert 0.35 < moved.any(1).mean() < 0.53 and 0.2 < moved[:, 2:].mean() < 0.3


def test_magicals_actions_by_number():
    actions = np.asarray(jax.vmap(magical.action)(np.arange(magical.NUM_ACTIONS)))
    assert len(np.unique(actions, axis=0)) == 18
    np.testing.assert_array_equal(actions[[0, 1, 2, 3, 6, 9, 13]], [
        [0, 0, 1], [1, 0, 1], [-1, 0, 1], [0, 1, 1], [0, -1, 1], [0, 0, -1], [1, 1, -1],
    ])  # fmt: skip


def test_the_drive_gains_the_same_speed_in_all_directions():
    task = env.MatchRegions(physics=FAITHFUL)
    start = task.reset(jax.random.key(0)).pipeline_state
    gained = FAITHFUL.drive_force / DRIVEN_MASS * CONTROL_DT
    for angle in (0.0, 0.8):
        away = start._replace(qpos=start.qpos.at[:3].set(jnp.array([0.3, 0.3, angle])))
        velocity = jit_physics(task.advance)(away, jnp.array([1.0, 0.0, 1.0])).qvel[:2]
        np.testing.assert_allclose(velocity, gained * geometry.heading(jnp.float32(angle)), atol=0.02)


def test_discrete_control_does_what_its_continuous_action_does():
    discrete, continuous = env.MatchRegions(control="discrete"), env.MatchRegions()
    start = continuous.reset(jax.random.key(0))
    for number in (1, 12):
        one = jit_physics(discrete.step)(start, jnp.int32(number)).pipeline_state.qpos
        other = jit_physics(continuous.step)(start, magical.action(jnp.int32(number))).pipeline_state.qpos
        np.testing.assert_allclose(one, other, atol=1e-6)
    with pytest.raises(ValueError, match="policies act continuously"):
        discrete.training()
    with pytest.raises(ValueError, match="control is 'keys'; allowed: 'continuous' and 'discrete'"):
        env.MatchRegions(control="keys")
