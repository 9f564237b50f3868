"""Environments whose answers are known: for the training loop a family with a value function in closed form, for the
wrappers a task of sliding boxes."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
from brax.envs.base import Env, State

from graphrl_jax.encoder.pooling import PoolingParams
from graphrl_jax.graph import ObjectTable


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class ProbeReward:
    """What `Probe` pays, all float32 scalars; changing any of them is a change of reward parameters.

    constant: paid at every step. observation: times x. last: paid at the step that reaches `length`.
    action: times -(a - x / 2)^2. length: steps per episode. terminates: 1 if the episode ends there by itself.
    shows_steps: 0 hides the steps from the observation.
    """

    constant: jax.Array | float = 0.0
    observation: jax.Array | float = 0.0
    last: jax.Array | float = 0.0
    action: jax.Array | float = 0.0
    length: jax.Array | float = 1.0
    terminates: jax.Array | float = 1.0
    shows_steps: jax.Array | float = 1.0


class Probe(Env):
    """x is -1 or 1 for a whole episode; the observation is (x, steps / 4)."""

    observation_size = 2
    action_size = 1
    backend = "none"

    def __init__(self, reward: ProbeReward):
        self.reward = reward

    def reset(self, rng: jax.Array) -> State:
        x = jax.random.rademacher(rng, (), dtype=jnp.float32)
        zero = jnp.zeros(())
        return State(
            pipeline_state={"x": x, "steps": zero},
            obs=jnp.stack([x, zero]),
            reward=zero,
            done=zero,
            metrics={"success": zero, "score": zero},
        )

    def step(self, state: State, action: jax.Array) -> State:
        pays = self.reward
        x = state.pipeline_state["x"]
        steps = state.pipeline_state["steps"] + 1
        at_end = (steps >= pays.length).astype(jnp.float32)
        error = action[0] - x / 2
        reward = pays.constant + pays.observation * x + pays.last * at_end - pays.action * error**2
        return state.replace(
            pipeline_state={"x": x, "steps": steps},
            obs=jnp.stack([x, pays.shows_steps * steps / 4]),
            reward=reward,
            done=at_end * pays.terminates,
            metrics={"success": (jnp.abs(error) < 0.2).astype(jnp.float32), "score": jnp.exp(-jnp.abs(error))},
        )


class SlidingBoxes(Env):
    """Two boxes of 0.1 x 0.1 and a robot; the action moves the first box along x by at most 0.1 per step.

    Reward: x of the first box. Success: it is past 0.5; the score is its x. The robot's slot is masked.
    """

    objects = ObjectTable(("mover", "rest", "robot"), (0, 0, 1), (False, False, True), ("box", "robot"))
    observation_size = 3
    action_size = 1
    backend = "none"

    def __init__(self, ends_by_itself_after: jax.Array | int = 1000):
        self.ends_by_itself_after = ends_by_itself_after

    def reset(self, rng: jax.Array) -> State:
        places = jax.random.uniform(rng, (3,), maxval=0.4)
        return self._state(places, jnp.zeros((), jnp.int32), jnp.zeros(()))

    def step(self, state: State, action: jax.Array) -> State:
        places, age = state.pipeline_state
        places = places.at[0].add(0.1 * action[0])
        fresh = self._state(places, age + 1, places[0])
        return fresh.replace(info=state.info)

    def boxes(self, state: State) -> tuple[jax.Array, jax.Array]:
        places, _ = state.pipeline_state
        size = jnp.full((3, 2), 0.1)
        centres = jnp.stack([places, jnp.full(3, 0.5)], axis=-1)
        return jnp.concatenate([centres, size], axis=-1), jnp.array([True, True, False])

    def _state(self, places: jax.Array, age: jax.Array, reward: jax.Array) -> State:
        done = (age >= self.ends_by_itself_after).astype(jnp.float32)
        metrics = {"success": (places[0] > 0.5).astype(jnp.float32), "score": places[0]}
        return State((places, age), places, reward, done, metrics)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class CountingModel:
    """Stands in for a learned reward: the distance is x of the first box plus 10 for every active slot."""

    kappa: jax.Array
    pooling: PoolingParams

    def distance(self, graph) -> jax.Array:
        return graph.boxes[0, 0] + 10.0 * jnp.sum(graph.active)

    def value(self, distance) -> jax.Array:
        return -self.kappa * distance

    def apply(self, graph) -> jax.Array:
        return self.value(self.distance(graph))
