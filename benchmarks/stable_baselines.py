"""Stable-Baselines3's PPO on Match Regions through Gymnasium, paid by the released reward model.

    python -m benchmarks.stable_baselines [--seeds 0 1 2] [--steps 2500000]

Every seed trains a policy of its own on the starts of policy training. Before and after, the policy's mode acts in the
same unseen episodes, which start as the task's own do. Sizes are those of this package's PPO where both have them;
an update's data are one episode of each environment. Needs `pip install -e ".[sb3]"`.

Writes stable_baselines.json to `benchmarks/results`, after every training. Trainings of other seeds with the same
settings that the file holds already stay in it.
"""

import importlib.metadata
import math
import os
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch  # pyright: ignore[reportMissingImports]
import tyro
from stable_baselines3 import PPO  # pyright: ignore[reportMissingImports]
from stable_baselines3.common.vec_env import VecNormalize  # pyright: ignore[reportMissingImports]

from benchmarks.context import RESULTS, measured_on
from graphrl_jax.gym import TaskVectorEnv
from graphrl_jax.gym.stable_baselines import StableBaselinesVecEnv
from graphrl_jax.reward.model import RewardModel
from graphrl_jax.rl.config import PPOConfig, PPOHyper
from graphrl_jax.runtime import configure
from graphrl_jax.storage import read_json, write_json

TASK = "match_regions"


@dataclass(frozen=True)
class Options:
    """Trains a policy per seed, and writes what they reach.

    Attributes:
      seeds: of the trainings.
      steps: control steps of each training.
      num_envs: environments of the training.
      minibatches: gradient steps per pass over an update's data.
      epochs: passes over an update's data.
      entropy_cost: weight of the entropy bonus.
      reward_model: folder of the reward model.
      episodes: unseen episodes of each evaluation.
      evaluation_seed: decides these episodes, the same for every policy.
      out: file of the results.
    """

    seeds: tuple[int, ...] = (0, 1, 2)
    steps: int = 2_500_000
    num_envs: int = 128
    minibatches: int = 16
    epochs: int = 4
    entropy_cost: float = 0.0
    reward_model: Path = Path("checkpoints/match_regions_graph")
    episodes: int = 128
    evaluation_seed: int = 1_000_000
    out: Path = RESULTS / "stable_baselines.json"


def training_of(options: Options, model: RewardModel, seed: int) -> PPO:
    """A PPO that has learned nothing yet; its environment normalises observations and rewards."""
    hyper, config = PPOHyper(), PPOConfig()
    simulated = TaskVectorEnv(TASK, options.num_envs, reward_model=model, training=True)
    envs = VecNormalize(StableBaselinesVecEnv(simulated), gamma=hyper.discount)
    unroll = simulated.task.episode_length
    return PPO(
        "MlpPolicy",
        envs,
        learning_rate=lambda left: hyper.final_learning_rate + left * (hyper.learning_rate - hyper.final_learning_rate),
        n_steps=unroll,
        batch_size=options.num_envs * unroll // options.minibatches,
        n_epochs=options.epochs,
        gamma=hyper.discount,
        gae_lambda=hyper.gae_lambda,
        clip_range=hyper.clip,
        ent_coef=options.entropy_cost,
        vf_coef=hyper.value_cost,
        max_grad_norm=hyper.max_grad_norm,
        policy_kwargs={
            "net_arch": {"pi": list(config.policy_hidden), "vf": list(config.value_hidden)},
            "log_std_init": math.log(config.initial_std),
        },
        seed=seed,
        device="cpu",
    )


def evaluate(ppo: PPO, envs: TaskVectorEnv, seed: int) -> dict[str, float]:
    """Success rate and mean score at the end of one episode in each environment, and the mean sum of its rewards."""
    observations, _ = envs.reset(seed=seed)
    returns, infos = np.zeros(envs.num_envs), {}
    for _ in range(envs.task.episode_length):
        actions, _ = ppo.predict(ppo.get_env().normalize_obs(observations), deterministic=True)
        observations, rewards, *_, infos = envs.step(actions)
        returns += rewards
    final = infos["final_info"]
    return {
        "success_rate": float(final["success"].mean()),
        "mean_score": float(final["score"].mean()),
        "mean_return": float(returns.mean()),
    }


def run(options: Options, model: RewardModel, unseen: TaskVectorEnv, seed: int) -> dict[str, Any]:
    """One training: what its policy reaches before and after, and how long it took."""
    ppo = training_of(options, model, seed)
    before = evaluate(ppo, unseen, options.evaluation_seed)
    started, used = time.perf_counter(), time.process_time()
    ppo.learn(options.steps)
    return {
        "seed": seed,
        "untrained": before,
        "trained": evaluate(ppo, unseen, options.evaluation_seed),
        "env_steps": ppo.num_timesteps,
        "train_s": time.perf_counter() - started,
        "cpu_s": time.process_time() - used,
    }


def earlier_runs(options: Options, settings: dict[str, Any]) -> list[dict[str, Any]]:
    """Trainings of other seeds with these settings in the file of the results."""
    found = read_json(options.out) if options.out.exists() else {"runs": [], "settings": settings}
    if found["settings"] != settings:
        return []
    return [earlier for earlier in found["runs"] if earlier["seed"] not in options.seeds]


def main() -> None:
    """Trains, prints and writes."""
    options = tyro.cli(Options, description=__doc__)
    configure()
    torch.set_num_threads(len(os.sched_getaffinity(0)))
    where = measured_on("stable_baselines") | {
        name: importlib.metadata.version(name) for name in ("stable_baselines3", "gymnasium", "torch")
    }
    model = RewardModel.load(options.reward_model)
    unseen = TaskVectorEnv(TASK, options.episodes, reward_model=model)
    settings = {name: value for name, value in asdict(options).items() if name not in ("seeds", "out", "reward_model")}
    runs = earlier_runs(options, settings)
    for seed in options.seeds:
        runs.append(run(options, model, unseen, seed))
        print(runs[-1])
        write_json(options.out, {"runs": runs, "settings": settings, "episodes": options.episodes, **where})


if __name__ == "__main__":
    main()
