"""The table of starts from the expert's episodes, and that a table is an input of the training program."""

from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from graphrl_jax.encoder import encoder
from graphrl_jax.encoder.config import EncoderConfig
from graphrl_jax.encoder.pooling import PoolingParams
from graphrl_jax.experiment.environments import TrainingParams, training_environment_of
from graphrl_jax.reward.model import RewardModel
from graphrl_jax.rl import ppo
from graphrl_jax.rl.config import PPOConfig, PPOHyper
from tasks.shoes_in_box import expert, training
from tasks.shoes_in_box.objects import OBJECTS
from tasks.shoes_in_box.starts import Starts
from tasks.shoes_in_box.state import success
from tasks.shoes_in_box.task import ShoesInBox
from tests.helpers.shoes_in_box import TASK, numbered_starts, repeated, scene

START = jax.jit(TASK.reset)(jax.random.key(0)).pipeline_state
BESIDE = scene(START, ((0.40, 0.33, 0.0), (0.40, -0.33, 0.0)))
INSIDE = scene(START, ((0.47, 0.07, 0.0), (0.47, -0.07, 0.0)), lid=2.0)
LID, SHOE_1, SHOE_2 = (OBJECTS.names.index(name) for name in ("lid", "shoe_1", "shoe_2"))


@pytest.fixture
def table(monkeypatch) -> Starts:
    """Of four episodes of 40 frames, of which the second and the last succeed."""
    beside, inside = repeated(BESIDE, 4, 40), repeated(INSIDE, 4, 40)
    done = (np.arange(40) >= 30) & np.array([0, 1, 0, 1], bool)[:, None]
    states = jax.tree.map(lambda a, b: jnp.where(done.reshape(4, 40, *[1] * (a.ndim - 2)), b, a), beside, inside)
    # The second episode opens the lid in frame 7, and lets go of a shoe in frame 34.
    states = states._replace(
        qpos=states.qpos.at[1, 7:, 9].set(2.0),
        touched=states.touched.at[1, 30:34, 0].set(True),
        frame=jnp.broadcast_to(jnp.arange(4, dtype=jnp.uint32)[:, None], (4, 40)),
    )
    monkeypatch.setattr(training, "EPISODES", 4)
    monkeypatch.setattr(expert, "episodes", lambda task, key, kinds: (states, jnp.full(4, 40)))
    return training.make_starts(TASK, jax.random.key(0), PoolingParams())


def test_only_successes_are_kept_and_fill_the_table(table):
    np.testing.assert_array_equal(table.states.frame[:, 0], [1, 3, 1, 3])
    assert jax.vmap(success)(jax.tree.map(lambda leaf: leaf[:, -1], table.states)).all()


def test_ends_of_jobs_and_activity_are_those_of_the_episode(table):
    np.testing.assert_array_equal(table.ends[:2], [[7, 30, 34], [30, 30, 30]])
    active = np.asarray(table.active[0])
    np.testing.assert_array_equal(active[:, LID], np.arange(40) >= 7)
    np.testing.assert_array_equal(active[:, [SHOE_1, SHOE_2]].T, [np.arange(40) >= 30] * 2)


TRACES = []
CONFIG = PPOConfig(
    num_envs=4, unroll_length=2, num_epochs=1, num_minibatches=1, episode_length=8, decision_steps=2,
    policy_hidden=(8,), value_hidden=(8,), progress=True,
)  # fmt: skip


class Counted(ShoesInBox):
    """The task, counted in `TRACES`."""

    def training(self, starts: Starts | None = None) -> ShoesInBox:
        TRACES.append(starts)
        return super().training(starts)


@cache
def counted(engine: str) -> Counted:
    return Counted(engine=engine)


def trained_on(engine: str, starts: Starts, alpha: float, seed: int, learning_rate: float) -> ppo.Metrics:
    make_env = training_environment_of(counted(engine), "graph")
    sizes = EncoderConfig(num_layers=1, hidden=4, embedding=3)
    params = encoder.init(jax.random.key(seed), sizes, OBJECTS)
    model = ppo.as_float32(RewardModel(params, jnp.zeros(3), 1.0, 1.0, PoolingParams(alpha=alpha)))
    inputs = TrainingParams(model, starts)
    state = ppo.init_jit(CONFIG, make_env, inputs, jax.random.key(seed))
    return ppo.train_chunk(CONFIG, make_env, PPOHyper(learning_rate=learning_rate), inputs, state, 1)[1]


@pytest.mark.parametrize("engine", ["mujoco", pytest.param("mjx", marks=pytest.mark.study)])
def test_other_starts_encoders_seeds_and_learning_rates_compile_nothing(engine):
    ends = np.array([[10, 20, 25], [5, 10, 15]])
    tables = [numbered_starts(state, ends, 30) for state in (BESIDE, INSIDE)]
    found = [trained_on(engine, tables[0], 1.0, 0, 1e-3)]
    count = len(TRACES)
    found += [trained_on(engine, tables[1], 1.0, 0, 1e-3), trained_on(engine, tables[1], 8.0, 0, 1e-3)]
    found += [trained_on(engine, tables[1], 8.0, 1, 3e-3)]
    assert len(TRACES) == count > 0
    rewards = [float(metrics["learned_reward"][0]) for metrics in found]
    assert np.isfinite(rewards).all() and len(set(rewards)) == 4
