"""Physics engines: one interface, behind which MJX, C MuJoCo or MuJoCo Warp moves the bodies of a task.

An engine takes the state, the actuators' controls and the model's fields that differ between environments; it returns
the state after some sub-steps and the readings of the model's sensors. The whole state goes in and comes out, so a step
is a pure function in every engine.

| engine   | runs on    | how                                                                                |
|----------|------------|------------------------------------------------------------------------------------|
| `mjx`    | any device | MuJoCo in JAX                                                                      |
| `mujoco` | CPU        | C MuJoCo on all cores, called back from the compiled program                       |
| `warp`   | NVIDIA GPU | MJX's Warp implementation; needs the package extra `warp`                          |
"""

import importlib.util
import threading
from collections.abc import Mapping
from functools import partial
from typing import Any, NamedTuple, Protocol

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from mujoco import mjx
from mujoco.batch import Batch

from graphrl_jax.registry import ENGINES

# Sizes of Warp's buffers per environment: contacts, and rows of the constraints' Jacobian.
_WARP_CONTACTS, _WARP_CONSTRAINTS = 48, 192


class Dynamics(NamedTuple):
    """State of the bodies. V coordinates, U rates.

    | field     | shape | dtype   | meaning                                 |
    |-----------|-------|---------|-----------------------------------------|
    | qpos      | (V,)  | float32 | coordinates, as in `mjx.Data`           |
    | qvel      | (U,)  | float32 | their rates                             |
    | warmstart | (U,)  | float32 | accelerations the solver starts from    |
    """

    qpos: jax.Array
    qvel: jax.Array
    warmstart: jax.Array


Fields = Mapping[str, jax.Array]
"""Fields of the model that differ between environments, by their names in `mujoco.MjModel`."""


class Engine(Protocol):
    """A physics engine with a model; `name` is one of `registry.ENGINES`."""

    name: str

    def step(
        self, dynamics: Dynamics, ctrl: jax.Array, fields: Fields | None = None, substeps: int = 1
    ) -> tuple[Dynamics, jax.Array]:
        """Steps of physics under constant controls, for one environment; map over batches with `jax.vmap`.

        Args:
          dynamics: the state.
          ctrl: (A,) float32, controls of the actuators.
          fields: see `Fields`; default: the model's own.
          substeps: number of steps, static.

        Returns:
          The next state, and the sensors' readings (S,) float32 at the beginning of the last step.
        """
        ...


def default_engine() -> str:
    """The fastest engine on the devices in use that needs no package extra: `mujoco` on one CPU device, else `mjx`."""
    return "mujoco" if jax.default_backend() == "cpu" and jax.device_count() == 1 else "mjx"


def make_engine(name: str | None, model: mujoco.MjModel) -> Engine:
    """The engine with this name, for a model; default: `default_engine`.

    Raises:
      ValueError: the name is unknown, or the engine cannot run here.
    """
    name = name or default_engine()
    if name not in ENGINES:
        raise ValueError(f"unknown engine {name!r}; known engines: {', '.join(ENGINES)}")
    backend = jax.default_backend()
    if name == "mujoco" and (backend != "cpu" or jax.device_count() > 1):
        here = f"{jax.device_count()} devices of kind {backend}"
        raise ValueError(f"engine 'mujoco' runs on one CPU device, but this process has {here}; allowed here: 'mjx'")
    if name == "warp" and importlib.util.find_spec("warp") is None:
        raise ValueError("engine 'warp' needs the package warp-lang: pip install 'graphrl_jax[warp]'")
    return MujocoEngine(model) if name == "mujoco" else MjxEngine(model, name)


class MjxEngine:
    """MJX with its own implementation in JAX (`mjx`) or with that in Warp (`warp`)."""

    def __init__(self, model: mujoco.MjModel, name: str = "mjx"):
        self.name = name
        if name == "warp":
            self._model = mjx.put_model(model, impl="warp")
            self._template = mjx.make_data(model, impl="warp", naconmax=_WARP_CONTACTS, njmax=_WARP_CONSTRAINTS)
        else:
            self._model, self._template = mjx.put_model(model), mjx.make_data(model)

    def step(
        self, dynamics: Dynamics, ctrl: jax.Array, fields: Fields | None = None, substeps: int = 1
    ) -> tuple[Dynamics, jax.Array]:
        # The rest of `mjx.Data` follows from these, so it need not be carried through programs.
        model = self._model.replace(**fields) if fields else self._model

        def substep(carry: tuple, _: None) -> tuple:
            (qpos, qvel, warmstart), _ = carry
            data = self._template.replace(qpos=qpos, qvel=qvel, qacc_warmstart=warmstart, ctrl=ctrl)
            data = mjx.step(model, data)
            return (Dynamics(data.qpos, data.qvel, data.qacc_warmstart), data.sensordata), None

        return jax.lax.scan(substep, (dynamics, self._template.sensordata), length=substeps)[0]


class MujocoEngine:
    """C MuJoCo: all environments of a call are stepped by `mujoco.batch.Batch` on a pool of threads."""

    name = "mujoco"

    def __init__(self, model: mujoco.MjModel):
        self._mj_model = model
        # A state that diverges stays so, as in MJX; MuJoCo would replace it by the model's default, unseen.
        self._mj_model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
        self._batches: dict[tuple, _Rows] = {}
        # A batch serves one call at a time.
        self._lock = threading.Lock()

    def step(
        self, dynamics: Dynamics, ctrl: jax.Array, fields: Fields | None = None, substeps: int = 1
    ) -> tuple[Dynamics, jax.Array]:
        readings = jax.ShapeDtypeStruct((self._mj_model.nsensordata,), jnp.float32)
        shapes = (*(jax.ShapeDtypeStruct(leaf.shape, jnp.float32) for leaf in dynamics), readings)
        run = partial(self._run, substeps)
        *after, found = jax.pure_callback(run, shapes, *dynamics, ctrl, dict(fields or {}), vmap_method="broadcast_all")
        return Dynamics(*after), found

    def _run(self, substeps: int, qpos: Any, qvel: Any, warmstart: Any, ctrl: Any, fields: Any) -> tuple:
        """The callback; NumPy alone, because a callback that calls JAX can wait for itself."""
        inputs = {"qpos": qpos, "qvel": qvel, "qacc_warmstart": warmstart, "ctrl": ctrl}
        inputs = {name: np.asarray(value) for name, value in inputs.items()}
        fields = {name: np.asarray(value) for name, value in fields.items()}
        axes = inputs["ctrl"].shape[:-1]
        number = int(np.prod(axes, dtype=int))
        with self._lock:
            key = (number, *fields)
            if key not in self._batches:
                self._batches[key] = _Rows(self._mj_model, number, tuple(fields))
            found = self._batches[key].step(inputs, fields, substeps)
        return tuple(value.reshape(*axes, value.shape[-1]) for value in found)


class _Rows:
    """A batch of a fixed number of simulations, with live arrays over its inputs and outputs."""

    def __init__(self, model: mujoco.MjModel, number: int, fields: tuple[str, ...]):
        self._batch = Batch(model, number)
        self._inputs = {name: self._batch.bind(name) for name in ("qpos", "qvel", "qacc_warmstart", "ctrl")}
        self._readings = self._batch.bind("sensordata")
        self._fields = {name: self._batch.expand(name) for name in fields}

    def step(self, inputs: dict[str, np.ndarray], fields: dict[str, np.ndarray], substeps: int) -> list[np.ndarray]:
        """Coordinates, rates, warm start and readings, float32 with one row per simulation."""
        for name, live in self._inputs.items():
            live[:] = inputs[name].reshape(live.shape)
        for name, live in self._fields.items():
            live[:] = fields[name].reshape(live.shape)
        self._batch.step(nstep=substeps)
        found = [self._inputs[name] for name in ("qpos", "qvel", "qacc_warmstart")]
        return [np.asarray(value, np.float32) for value in (*found, self._readings)]
