"""MAGICAL's variants: what differs between episodes, that nothing else does, and that one program plays them all."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from graphrl_jax import demonstrations as demonstration_files
from graphrl_jax.encoder.pooling import PoolingParams
from graphrl_jax.experiment.settings import compose
from graphrl_jax.registry import make_task, task_names
from graphrl_jax.rl.wrappers import EnvironmentReward
from graphrl_jax.runtime import jit_physics
from tasks.match_regions import geometry, layouts, state, variants
from tasks.match_regions.model import FINGER_OPEN
from tasks.match_regions.observation import observe
from tasks.match_regions.task import MatchRegions
from tests.helpers.match_regions import DEMO

DRAWS = 256
TASK = variants.make("all")
ADVANCE = jit_physics(TASK.advance)


@pytest.fixture(scope="module")
def starts() -> dict[str, layouts.Start]:
    """Many starts of every variant, on the host; one program draws them all."""
    draw = jax.jit(lambda variant, keys: jax.vmap(variant.sample)(keys))
    keys = jax.random.split(jax.random.key(0), DRAWS)
    drawn = {name: jax.tree.map(np.asarray, draw(variant, keys)) for name, variant in variants.VARIANTS.items()}
    assert draw._cache_size() == 1
    return drawn


def test_demo_is_the_demonstrations_scene(starts: dict[str, layouts.Start]) -> None:
    qpos, _, homes, world = starts["demo"]
    np.testing.assert_allclose(world.region, np.tile(geometry.REGION, (DRAWS, 1)), atol=1e-6)
    for name in ("colours", "shapes", "present"):
        np.testing.assert_array_equal(getattr(world, name)[:, :5], np.tile(getattr(DEMO, name), (DRAWS, 1)))
    assert not world.present[:, 5:].any()
    poses = qpos[:, 5:].reshape(DRAWS, 8, 3)
    assert np.abs(poses[:, :5] - layouts.BLOCK_STARTS).max() <= 0.005 + 1e-6
    np.testing.assert_array_equal(homes, poses[:, :2, :2])


@pytest.mark.parametrize(
    "name, changing",
    [
        ("demo", set()),
        ("jitter", {"region"}),
        ("colour", {"colours", "region_colour"}),
        ("shape", {"shapes"}),
        ("layout", {"region"}),
        ("count", {"region", "present", "strengths"}),
        ("count_plus", {"colours", "region_colour", "shapes", "region", "present"}),
        ("dynamics", {"strengths"}),
        ("all", {"colours", "region_colour", "shapes", "region", "present", "strengths"}),
    ],
)
def test_only_what_a_variant_names_differs(starts, name: str, changing: set[str]) -> None:
    world = starts[name].world._asdict()
    differs = {field for field, values in world.items() if np.ptp(values.astype(float), axis=0).max() > 1e-6}
    assert differs == changing


def test_counts_and_colours_are_magicals(starts: dict[str, layouts.Start]) -> None:
    world = starts["count_plus"].world
    assert set(world.present[:, :2].sum(1)) == {1, 2} and world.present[:, 0].all()
    assert (world.colours[:, :2] == world.region_colour[:, None]).all()
    per_colour = np.stack([(world.present & (world.colours == colour)).sum(1) for colour in range(4)], axis=1)
    others = per_colour[np.arange(4) != world.region_colour[:, None]].reshape(DRAWS, 3)
    assert set(others.ravel()) == {0, 1, 2}
    # With one region colour, three other colours of none, one and two blocks each: all 27 combinations.
    assert len(np.unique(others, axis=0)) == 27
    assert set(world.shapes.ravel()) == {0, 1, 2, 3} and set(world.region_colour) == {0, 1, 2, 3}
    demo_counts = (starts["colour"].world.present & ~np.isin(np.arange(8), [0, 1])).sum(1)
    np.testing.assert_array_equal(demo_counts, 3)


def test_layouts_are_clear_of_the_region_and_of_each_other(starts: dict[str, layouts.Start]) -> None:
    qpos, _, _, world = starts["layout"]
    sides = world.region[:, 1::2] - world.region[:, ::2]
    assert sides.min() >= 0.5 - 1e-6 and sides.max() <= 0.8 + 1e-6 and np.abs(world.region).max() <= 1 + 1e-6
    places = np.concatenate([qpos[:, None, :2], qpos[:, 5:20].reshape(DRAWS, 5, 3)[..., :2]], axis=1)
    inside = jax.vmap(geometry.inside_region)(world.region, places)
    assert np.mean(inside) < 0.01
    gaps = np.linalg.norm(places[:, :, None] - places[:, None], axis=-1) + 10 * np.eye(6)
    assert np.mean(gaps.min((1, 2)) > 0.24) > 0.95


def test_jitter_has_magicals_bounds(starts: dict[str, layouts.Start]) -> None:
    qpos, _, _, world = starts["jitter"]
    offsets = np.abs(qpos[:, 5:20].reshape(DRAWS, 5, 3) - layouts.BLOCK_STARTS).max((0, 1))
    np.testing.assert_allclose(offsets, [0.025, 0.025, 0.05 * np.pi], rtol=0.02)
    sides = world.region[:, 1::2] - world.region[:, ::2]
    assert np.abs(sides - [0.6, 0.7]).max() <= 0.0075 + 1e-6


def test_all_variants_are_stepped_by_one_program() -> None:
    traces = []

    @jit_physics
    def play(variant: variants.Variant, key: jax.Array) -> tuple[jax.Array, jax.Array]:
        traces.append(None)
        env = EnvironmentReward(TASK.with_layout(variant), PoolingParams())
        start = env.reset(key)
        end, _ = jax.lax.scan(lambda s, _: (env.step(s, jnp.array([1.0, 0.3, -1.0])), None), start, length=8)
        return end.obs, end.info["class_ids"]

    ends = {name: play(variant, jax.random.key(3)) for name, variant in variants.VARIANTS.items()}
    assert len(traces) == 1
    for name, (obs, classes) in ends.items():
        assert np.isfinite(obs).all(), name
        if name in ("demo", "jitter", "layout", "dynamics"):
            np.testing.assert_array_equal(classes[:7], TASK.objects.class_ids[:7])
    # Other forces, another motion; the same start otherwise.
    assert not np.allclose(ends["demo"][0], ends["dynamics"][0], atol=1e-3)


def test_the_demo_variant_moves_as_the_fast_task_does() -> None:
    fast = MatchRegions(layouts.Demo(jitter=0.0))
    advance, one = jit_physics(fast.advance), fast.reset(jax.random.key(0)).pipeline_state
    other = TASK.with_layout(variants.Variant()).reset(jax.random.key(0)).pipeline_state
    # Beside the square and holding it.
    held = one.qpos.at[:3].set(jnp.array([-0.35, 0.72, jnp.pi / 2]))
    one, other = one._replace(qpos=held), other._replace(qpos=other.qpos.at[:20].set(held))
    for drive in 3 * ([0.0, 0.0, -1.0],) + 4 * ([-1.0, 0.4, -1.0],):
        one = advance(one, jnp.array(drive))
        other = ADVANCE(other, jnp.array(drive))
    assert np.linalg.norm(one.qpos[8:10] - layouts.BLOCK_STARTS[1, :2]) > 0.05
    np.testing.assert_allclose(other.qpos[:20], one.qpos, atol=2e-3)
    np.testing.assert_allclose(other.qpos[20:], np.ravel([[3.0 + i, 3.0, 0.0] for i in (5, 6, 7)]), atol=1e-5)


def test_forces_scale_what_the_robot_does() -> None:
    start = TASK.with_layout(variants.Variant()).reset(jax.random.key(0)).pipeline_state

    def after(strengths: list[float], action: list[float]) -> np.ndarray:
        world = start.world._replace(strengths=jnp.array(strengths))
        return np.asarray(ADVANCE(start._replace(world=world), jnp.array(action)).qvel)

    ahead, turn = [1.0, 0.0, 1.0], [0.0, 1.0, 1.0]
    usual, weak = after([1.0] * 5, ahead), after([0.5, 1.0, 1.0, 1.0, 1.0], ahead)
    np.testing.assert_allclose(np.linalg.norm(weak[:2]), np.linalg.norm(usual[:2]) / 2, rtol=0.05)
    assert after([1.0, 0.3, 1.0, 1.0, 1.0], turn)[2] < 0.9 * after([1.0] * 5, turn)[2]


def test_what_is_not_there_takes_part_in_nothing() -> None:
    start = TASK.with_layout(variants.Variant()).reset(jax.random.key(0))
    physics = start.pipeline_state
    lone = physics._replace(world=physics.world._replace(present=jnp.arange(8) == 0))
    boxes, mask = TASK.scene_boxes(lone.qpos, lone.world)
    np.testing.assert_array_equal(mask, [True, True, True] + [False] * 7)
    obs = np.asarray(observe(lone))
    # Of the second target only the flag that it needs no bringing and where it began are left; no distractor is seen.
    np.testing.assert_array_equal(obs[26:37][[0, 1, 2, 3, 4, 5, 7, 8, 9]], 0)
    assert obs[32] == 1 and obs[37] == 1
    np.testing.assert_array_equal(obs[38:], 0)
    inside = lone.qpos.at[5:7].set(jnp.array([0.4, 0.3]))
    assert float(state.score(inside, lone.world)) == 1.0 and float(state.score(lone.qpos, lone.world)) == 0.0
    assert np.asarray(boxes)[2, 0] == pytest.approx((layouts.BLOCK_STARTS[0, 0] + 1.02) / 2.04, abs=0.01)


def test_training_starts_respect_the_drawn_scene() -> None:
    sample = jax.jit(jax.vmap(layouts.Training(variants.VARIANTS["all"]).sample))
    qpos, moved, homes, world = jax.tree.map(np.asarray, sample(jax.random.split(jax.random.key(5), 512)))
    poses = qpos[:, 5:].reshape(-1, 8, 3)
    there = np.abs(poses[..., :2]).max(-1) <= 0.88 + 1e-6
    np.testing.assert_array_equal(there, world.present)
    assert not (moved & ~world.present).any() and moved[:, 2:].any()
    inside = np.asarray(jax.vmap(state.inside)(qpos, world))
    assert 0.1 < inside[:, :2].mean() < 0.45
    # A target that begins inside counts as brought from where the layout had it, which is outside.
    brought = np.asarray(jax.vmap(geometry.inside_region)(world.region, homes))
    assert brought[world.present[:, :2]].mean() < 0.12
    held = np.abs(qpos[:, 3]) < FINGER_OPEN - 0.01
    assert 0.1 < held.mean() < 0.4


def test_demonstrations_of_a_variant_carry_their_classes(tmp_path) -> None:
    task = make_task("match_regions_colour")
    demos = task.demonstrate(jax.random.key(0), successes=4, failures=2)
    assert demos.task == "match_regions_colour" and demos.classes is not None
    assert len(np.unique(demos.classes[:, 0])) > 1
    assert demos.event_names == ("target_1_placed", "target_2_placed", "both_placed")
    demos.save(tmp_path / "demos.npz")
    loaded = demonstration_files.load(tmp_path / "demos.npz")
    np.testing.assert_array_equal(loaded.class_ids(), demos.classes)
    np.testing.assert_array_equal(loaded.select([2]).class_ids(), demos.classes[2:3])


def test_every_variant_is_a_registered_task() -> None:
    assert {f"match_regions_{name}" for name in variants.VARIANTS} <= set(task_names())
    assert make_task("match_regions_count_plus").layout == variants.VARIANTS["count_plus"]


def test_policies_are_trained_longer_where_everything_is_anywhere() -> None:
    longer = {
        name
        for name in variants.VARIANTS
        if compose(variants.make(name)).updates > compose(make_task("match_regions")).updates
    }
    assert longer == {"layout", "count", "count_plus", "all"}
    settings = compose(variants.make("layout"))
    assert settings.ppo_config.policy_hidden == (256, 256) and settings.ppo_config.activation == "swish"
    assert compose(variants.make("count"), "graph").pretrain.temperature == 0.001
    assert compose(variants.make("layout"), preset="smoke") == replace(
        compose(make_task("match_regions"), preset="smoke"), task="match_regions_layout"
    )
