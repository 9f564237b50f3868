"""Our PPO against Brax's own, on one small task: the return at equal environment steps.

    python -m benchmarks.brax_ppo_parity [--seeds 8] [--checkpoints 4] [--updates-per-checkpoint 10] [--out FILE]

Both loops get the same task, networks (Brax's, with Brax's initialisation), hyper-parameters, numbers of environments,
steps and gradient steps, and neither normalises rewards or staggers episodes. What stays different on purpose: our
resets are fresh where Brax replays cached ones, and our observation statistics move after an update's gradient steps.
The policies of both are judged by the same evaluation, deterministic, on the same episodes.

Brax's `ppo.train` calls `jax.device_put_replicated`, which jax 0.10 no longer has; on one device it puts a new axis of
length 1 in front of every array, and that is what stands in for it here.
"""

import os
import time
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import tyro
from brax.envs.base import Env, State
from brax.training.agents.ppo import train as brax_ppo
from brax.training.agents.ppo.losses import PPONetworkParams
from brax.training.agents.ppo.networks import make_ppo_networks
from brax.training.networks import ACTIVATION

from benchmarks.checks import refuse_below
from benchmarks.context import measured_on
from graphrl_jax.rl import ppo
from graphrl_jax.rl.config import PPOConfig, PPOHyper
from graphrl_jax.rl.networks import make_networks
from graphrl_jax.rl.rollout import evaluate
from graphrl_jax.runtime import configure
from graphrl_jax.storage import write_json

CONFIG = PPOConfig(
    num_envs=128,
    unroll_length=16,
    num_epochs=4,
    num_minibatches=4,
    episode_length=50,
    policy_hidden=(32, 32),
    value_hidden=(32, 32),
    normalise_reward=False,
    stagger_episodes=False,
)
HYPER = PPOHyper(
    learning_rate=1e-3, final_learning_rate=1e-3, discount=0.97, gae_lambda=0.95, clip=0.2, entropy_cost=1e-3
)
EVALUATION_EPISODES = 256

Curve = list[float]


@dataclass(frozen=True)
class Options:
    """Learning curves of both loops.

    Attributes:
      seeds: training runs of each loop.
      checkpoints: points on the curve after the start.
      updates_per_checkpoint: updates between two points.
      out: where the numbers go.
    """

    seeds: int = 8
    checkpoints: int = 4
    updates_per_checkpoint: int = 10
    out: Path = Path("benchmarks/results/brax_ppo_parity.json")

    def __post_init__(self) -> None:
        refuse_below(self, seeds=2, checkpoints=1, updates_per_checkpoint=1)


class PointMass(Env):
    """A point with inertia in the plane, pushed towards a goal; reward: minus the distance, per step."""

    observation_size = 6
    action_size = 2
    backend = "none"

    def reset(self, rng: jax.Array) -> State:
        place, goal = jax.random.uniform(rng, (2, 2), minval=-1.0, maxval=1.0)
        zero = jnp.zeros(())
        points = jnp.concatenate([place, jnp.zeros(2), goal])
        return State(points, points, zero, zero)

    def step(self, state: State, action: jax.Array) -> State:
        place, velocity, goal = jnp.split(state.pipeline_state, 3)
        velocity = 0.8 * velocity + 0.05 * action
        place = place + velocity
        points = jnp.concatenate([place, velocity, goal])
        reward = -jnp.linalg.norm(place - goal)
        return state.replace(pipeline_state=points, obs=points, reward=reward)


TASK = PointMass()


def make_env(_: Any) -> Env:
    """The task has no reward parameters."""
    return TASK


def mean_return(policy_params: Any) -> float:
    """Of the deterministic policy, over the same episodes for whoever asks."""
    outcomes = evaluate(CONFIG, make_env, jnp.zeros(()), policy_params, jax.random.key(1_000), EVALUATION_EPISODES)
    return float(jnp.mean(outcomes["episode_return"]))


@jax.jit
def start(key: jax.Array) -> ppo.TrainState:
    """Our initial state with Brax's initial networks: ours (actions near 0, a set deviation) would be a head start."""
    state_key, policy_key, value_key = jax.random.split(key, 3)
    network = make_networks(CONFIG, TASK.observation_size, TASK.action_size)
    params = PPONetworkParams(network.policy_network.init(policy_key), network.value_network.init(value_key))
    return replace(ppo.init(CONFIG, make_env, jnp.zeros(()), state_key), params=params)


def our_curve(options: Options, seed: int) -> Curve:
    """Mean returns at the start and at each checkpoint."""
    nothing = jnp.zeros(())
    state = start(jax.random.key(seed))
    curve = [mean_return(ppo.policy_params(state))]
    for _ in range(options.checkpoints):
        state, _ = ppo.train_chunk(CONFIG, make_env, HYPER, nothing, state, options.updates_per_checkpoint)
        curve.append(mean_return(ppo.policy_params(state)))
    return curve


def brax_curve(options: Options, seed: int) -> Curve:
    """The same from Brax's `ppo.train`."""
    curve: Curve = []
    steps: list[int] = []

    def record(step: int, _: Any, params: Any) -> None:
        steps.append(step)
        curve.append(mean_return(params[:2]))

    brax_ppo.train(
        environment=TASK,
        num_timesteps=options.checkpoints * options.updates_per_checkpoint * CONFIG.steps_per_update,
        max_devices_per_host=1,
        num_envs=CONFIG.num_envs,
        episode_length=CONFIG.episode_length,
        unroll_length=CONFIG.unroll_length,
        batch_size=CONFIG.num_envs // CONFIG.num_minibatches,
        num_minibatches=CONFIG.num_minibatches,
        num_updates_per_batch=CONFIG.num_epochs,
        learning_rate=HYPER.learning_rate,
        discounting=HYPER.discount,
        gae_lambda=HYPER.gae_lambda,
        clipping_epsilon=HYPER.clip,
        entropy_cost=HYPER.entropy_cost,
        max_grad_norm=HYPER.max_grad_norm,
        vf_loss_coefficient=HYPER.value_cost,
        normalize_observations=True,
        network_factory=partial(
            make_ppo_networks,
            policy_hidden_layer_sizes=CONFIG.policy_hidden,
            value_hidden_layer_sizes=CONFIG.value_hidden,
            activation=ACTIVATION[CONFIG.activation],
        ),
        num_evals=options.checkpoints + 1,
        run_evals=False,
        policy_params_fn=record,
        seed=seed,
    )
    if steps != step_axis(options):
        raise RuntimeError(f"Brax took {steps} environment steps; expected {step_axis(options)}")
    return curve


def step_axis(options: Options) -> list[int]:
    """Environment steps at each point of a curve."""
    per_point = options.updates_per_checkpoint * CONFIG.steps_per_update
    return [point * per_point for point in range(options.checkpoints + 1)]


def supply_device_put_replicated() -> None:
    """Gives jax back, for one device, what Brax's loop calls."""

    def device_put_replicated(tree: Any, devices: list[Any]) -> Any:
        if len(devices) != 1:
            raise ValueError(f"devices has {len(devices)} entries; allowed: 1")
        return jax.tree.map(lambda leaf: jnp.asarray(leaf)[None], tree)

    jax.device_put_replicated = device_put_replicated


def compare(ours: np.ndarray, brax: np.ndarray) -> dict[str, Any]:
    """Curves (seeds, points) summed up by their last point and by the mean over all points after the start.

    Two means count as the same if they lie within two standard errors of their difference, or within 5 % of what Brax
    gained, whichever is more.
    """
    gained = float(brax[:, -1].mean() - brax[:, 0].mean())
    reductions = {"final": lambda curves: curves[:, -1], "mean_of_curve": lambda curves: curves[:, 1:].mean(1)}
    results: dict[str, Any] = {"brax_gain": gained}
    for name, reduce in reductions.items():
        a, b = reduce(ours), reduce(brax)
        difference = float(a.mean() - b.mean())
        standard_error = float(np.sqrt(a.var(ddof=1) / len(a) + b.var(ddof=1) / len(b)))
        tolerance = max(2.0 * standard_error, 0.05 * abs(gained))
        verdict = "same" if abs(difference) <= tolerance else "ours higher" if difference > 0 else "brax higher"
        results[name] = {
            "verdict": verdict, "difference": difference, "standard_error": standard_error, "tolerance": tolerance
        }  # fmt: skip
    return results


def main() -> None:
    """Trains both, prints the verdict and writes the JSON."""
    options = tyro.cli(Options, description=__doc__)
    configure()
    # The programs run for seconds and would be compiled for minutes. Nothing here is timed.
    if jax.__version_info__ < (0, 11):
        os.environ["XLA_FLAGS"] = os.environ.get("XLA_FLAGS", "") + " --xla_cpu_use_fusion_emitters=false"
    jax.config.update("jax_disable_most_optimizations", True)
    supply_device_put_replicated()
    started = time.perf_counter()
    seeds = list(range(options.seeds))
    curves = {
        "ours": np.array([our_curve(options, seed) for seed in seeds]),
        "brax": np.array([brax_curve(options, seed) for seed in seeds]),
    }
    comparison = compare(curves["ours"], curves["brax"])
    write_json(
        options.out,
        {
            **comparison,
            "env_steps": step_axis(options),
            "mean_return": {name: curve.mean(0).tolist() for name, curve in curves.items()},
            "deviation_over_seeds": {name: curve.std(0, ddof=1).tolist() for name, curve in curves.items()},
            "curves": {name: curve.tolist() for name, curve in curves.items()},
            "seeds": seeds,
            "config": vars(CONFIG),
            "hyper": vars(HYPER),
            "evaluation_episodes": EVALUATION_EPISODES,
            **measured_on("brax_ppo_parity"),
            "seconds": time.perf_counter() - started,
        },
    )
    print(f"{comparison}; written to {options.out}")


if __name__ == "__main__":
    main()
