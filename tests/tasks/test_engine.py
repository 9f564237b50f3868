"""Physics engines: the same motion behind one seam, pure and batched, and refusals in one sentence."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

from graphrl_jax.registry import ENGINES, make_task
from graphrl_jax.runtime import jit_physics
from tasks import engine
from tasks.engine import Dynamics, MjxEngine, MujocoEngine, default_engine, make_engine

# A pendulum that a servo drives against a wall, and a sensor of their contact.
MODEL = """
<mujoco>
  <option timestep="0.01" integrator="implicitfast"><flag eulerdamp="disable"/></option>
  <default><geom contype="0" conaffinity="0"/></default>
  <worldbody>
    <geom name="wall" type="box" size="0.1 0.1 0.5" pos="0.45 0 0"/>
    <body name="arm" pos="0 0 0.4">
      <joint name="hinge" axis="0 1 0" damping="0.5"/>
      <geom name="bob" type="sphere" size="0.05" pos="0 0 -0.4" mass="1"/>
    </body>
  </worldbody>
  <contact><pair geom1="bob" geom2="wall" condim="1"/></contact>
  <actuator><position joint="hinge" kp="40" kv="4"/></actuator>
  <sensor><contact geom1="bob" geom2="wall" data="found"/></sensor>
</mujoco>"""
SUBSTEPS = 5
START = Dynamics(jnp.zeros(1), jnp.zeros(1), jnp.zeros(1))


@pytest.fixture(scope="module")
def engines() -> dict[str, engine.Engine]:
    return {
        "mjx": MjxEngine(mujoco.MjModel.from_xml_string(MODEL)),
        "mujoco": MujocoEngine(mujoco.MjModel.from_xml_string(MODEL)),
    }


def run(one: engine.Engine, ctrl: jax.Array, steps: int, fields: dict | None = None) -> tuple[Dynamics, jax.Array]:
    """States and readings (steps, B, ...) of pendulums that start at rest under controls (B, 1)."""

    @jit_physics
    def simulate(ctrl: jax.Array) -> tuple[Dynamics, jax.Array]:
        def body(dynamics: Dynamics, _: None) -> tuple:
            step = jax.vmap(lambda d, c, f: one.step(d, c, f, SUBSTEPS), in_axes=(0, 0, 0 if fields else None))
            dynamics, found = step(dynamics, ctrl, fields or {})
            return dynamics, (dynamics, found)

        start = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (ctrl.shape[0], 1)), START)
        return jax.lax.scan(body, start, length=steps)[1]

    return jax.tree.map(np.asarray, simulate(ctrl))


def test_both_engines_move_alike_and_touch_at_the_same_time(engines):
    ctrl = jnp.array([[-0.5], [0.0], [-2.0]])
    (mine, touched), (other, felt) = (run(engines[name], ctrl, 40) for name in ("mjx", "mujoco"))
    np.testing.assert_allclose(mine.qpos, other.qpos, atol=2e-3)
    np.testing.assert_allclose(mine.qvel[-1], other.qvel[-1], atol=0.02)
    np.testing.assert_array_equal(touched > 0, felt > 0)
    assert felt[-1, 2, 0] and not felt[:, :2].any(), "only the third pendulum reaches the wall"


def test_a_step_is_mujocos_own(engines):
    model = mujoco.MjModel.from_xml_string(MODEL)
    data = mujoco.MjData(model)
    data.ctrl[:] = -2.0
    expected = []
    for _ in range(40):
        mujoco.mj_step(model, data, SUBSTEPS)
        expected.append(data.qpos.copy())
    found, _ = run(engines["mujoco"], jnp.array([[-2.0]]), 40)
    np.testing.assert_allclose(found.qpos[:, 0], expected, atol=1e-4)


@pytest.mark.parametrize("name", ["mjx", "mujoco"])
def test_fields_of_the_model_differ_between_environments(engines, name):
    places = jnp.asarray(mujoco.MjModel.from_xml_string(MODEL).body_pos, jnp.float32)
    lower = jnp.stack([places, places.at[1, 0].add(-1.0)])
    ctrl = jnp.full((2, 1), -2.0)
    _, touched = run(engines[name], ctrl, 40, {"body_pos": lower})
    assert touched[-1, 0, 0] and not touched[:, 1].any(), "the second arm hangs a metre from the wall"
    # The model's own field comes back with the next call that names none.
    assert run(engines[name], ctrl, 40)[1][-1].all()


def test_a_step_depends_on_its_inputs_alone_and_maps_over_two_axes(engines):
    one = engines["mujoco"]
    ctrl = jnp.array([[[-2.0], [0.3]], [[1.0], [0.0]]])
    start = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (2, 2, 1)), START)
    both = jit_physics(jax.vmap(jax.vmap(lambda d, c: one.step(d, c, None, SUBSTEPS))))
    first, _ = both(start, ctrl)
    again, _ = both(start, ctrl)
    jax.tree.map(np.testing.assert_array_equal, first, again)
    flat = jit_physics(jax.vmap(lambda d, c: one.step(d, c, None, SUBSTEPS)))
    rows, _ = flat(jax.tree.map(lambda leaf: leaf.reshape(4, 1), start), ctrl.reshape(4, 1))
    jax.tree.map(lambda a, b: np.testing.assert_array_equal(a.reshape(4, 1), b), first, rows)
    alone, _ = jit_physics(lambda d, c: one.step(d, c, None, SUBSTEPS))(START, ctrl[0, 0])
    np.testing.assert_array_equal(alone.qpos, first.qpos[0, 0])


def test_large_batches_do_not_wait_for_their_own_inputs(engines):
    """With asynchronous dispatch, arrays of this size hung."""
    ctrl = jnp.zeros((50_000, 1))
    states, _ = run(engines["mujoco"], ctrl, 2)
    assert states.qpos.shape == (2, 50_000, 1)


def test_a_diverged_state_is_not_replaced_unseen(engines, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)  # MuJoCo writes a log
    broken = START._replace(qpos=jnp.full(1, jnp.nan))
    after, _ = jit_physics(lambda d: engines["mujoco"].step(d, jnp.zeros(1), None, 1))(broken)
    assert not np.isfinite(after.qpos).any()


def test_the_default_is_the_fastest_here_and_names_are_checked(monkeypatch):
    model = mujoco.MjModel.from_xml_string(MODEL)
    assert default_engine() == "mujoco" and make_engine(None, model).name == "mujoco"
    with pytest.raises(ValueError, match="unknown engine 'bullet'; known engines: mjx, mujoco, warp"):
        make_engine("bullet", model)
    monkeypatch.setattr(engine.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(
        ValueError, match=r"engine 'warp' needs the package warp-lang: pip install 'graphrl_jax\[warp\]'"
    ):
        make_engine("warp", model)


@pytest.mark.parametrize("backend, devices", [("gpu", 1), ("cpu", 8)])
def test_mujoco_is_refused_elsewhere_than_on_one_cpu_device(monkeypatch, backend, devices):
    monkeypatch.setattr(jax, "default_backend", lambda: backend)
    monkeypatch.setattr(jax, "device_count", lambda: devices)
    assert default_engine() == "mjx"
    message = f"engine 'mujoco' runs on one CPU device, but this process has {devices} devices of kind {backend}"
    with pytest.raises(ValueError, match=message):
        make_engine("mujoco", mujoco.MjModel.from_xml_string(MODEL))


def test_registered_tasks_take_an_engine():
    assert make_task("match_regions_layout", "mjx").engine.name == "mjx"
    assert make_task("shoes_in_box").engine.name == default_engine()
    assert set(ENGINES) == {"mjx", "mujoco", "warp"}


@pytest.mark.study
def test_warp_moves_alike_where_its_package_is(engines):
    pytest.importorskip("warp")
    ctrl = jnp.array([[-0.5], [-2.0]])
    warp = MjxEngine(mujoco.MjModel.from_xml_string(MODEL), "warp")
    (mine, touched), (other, felt) = run(warp, ctrl, 10), run(engines["mujoco"], ctrl, 10)
    np.testing.assert_allclose(mine.qpos, other.qpos, atol=2e-3)
    np.testing.assert_array_equal(touched > 0, felt > 0)
