"""The stages of a run, each a function of what came before: demonstrations -> encoder -> reward -> policy -> numbers.

Training itself is in `training.py`; here is what comes before and after it. `train.py` strings them together.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache, partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from graphrl_jax import demonstrations as demonstration_files
from graphrl_jax import plots, ppo, stages
from graphrl_jax.demonstrations import Demonstrations
from graphrl_jax.discrimination import discrimination
from graphrl_jax.encoder import EncoderConfig
from graphrl_jax.encoder import init as init_encoder
from graphrl_jax.evaluation import evaluate
from graphrl_jax.evaluators import cycle_consistency, kendall_tau, value_order_correlation
from graphrl_jax.landscape import Landscape, Picture, audit, trajectory_scores
from graphrl_jax.ppo_config import PPOConfig, PPOHyper
from graphrl_jax.pretrain import PretrainHyper
from graphrl_jax.reward import RewardModel, demonstration_embeddings, demonstration_rewards
from graphrl_jax.runs import Run, load_tree, write_json
from graphrl_jax.settings import Settings
from graphrl_jax.task import Task
from graphrl_jax.wrappers import EnvironmentReward, GraphReward, PixelReward

# One key per use, folded into the run's seed, so that a stage's randomness does not depend on which stages ran.
DEMONSTRATIONS, PRETRAIN, LANDSCAPE, POLICY, _EVALUATION, RECORDING, GOAL = range(7)

WITH_ROBOT = {"suppress_robot": 0.0, "robot_messages": 1.0}
"""Floats of pretraining w/ robot: one that is pooled also sends messages."""
_GRAPHIRL = {"alpha": 1.0, "reconstruction_weight": 0.0, "robot_messages": 0.0}
_ABLATED: dict[str, dict[str, float]] = {"reconstruction": {"reconstruction_weight": 0.0}, "activity": {"alpha": 1.0}}
STAGE_METHODS = ("rests", "change_points", "uvd")


def stage_key(seed: int, stage: int) -> jax.Array:
    """The typed key of a stage."""
    return jax.random.fold_in(jax.random.key(seed), stage)


def make_demonstrations(task: Task, settings: Settings) -> Demonstrations:
    """The demonstrations of a run: a file's if one is given, else the expert's, with failures for the audit.

    Raises:
      DemonstrationError: see `given_demonstrations`.
    """
    if settings.demos is not None:
        return given_demonstrations(task, settings)
    count, size = settings.sizes.demonstrations, settings.pretraining.encoder.picture_size
    drawn = {} if size is None else {"picture_size": size}
    return task.demonstrate(stage_key(settings.seed, DEMONSTRATIONS), count, count // 4, **drawn)


def given_demonstrations(task: Task, settings: Settings) -> Demonstrations:
    """The demonstrations of the file in `settings.demos`.

    Raises:
      DemonstrationError: the file is no demonstration file, one of another task, or without the pictures needed.
    """
    assert settings.demos is not None
    loaded = demonstration_files.load(settings.demos)
    if loaded.objects != task.objects:
        raise demonstration_files.DemonstrationError(
            f"{settings.demos}: objects are {loaded.objects.names}, but task {task.name} has {task.objects.names}"
        )
    size = settings.pretraining.encoder.picture_size
    if size is not None:
        try:
            loaded.pictures(size)
        except demonstration_files.DemonstrationError as error:
            raise demonstration_files.DemonstrationError(
                f"{settings.demos}: {error}; `demos --pictures {size}` makes them"
            ) from error
    return loaded


def pretrain_hyper(task: Task, alpha: float, reward: str, ablations: Sequence[str] = ()) -> PretrainHyper:
    """The task's floats of pretraining as a reward has them, without what is ablated.

    GraphIRL's has TCC alone, a plain mean and, w/o robot, no node for it: all else is ours, rearrangements included.
    """
    changes = {"alpha": alpha}
    changes |= _GRAPHIRL if reward.startswith("graphirl") else {}
    changes |= WITH_ROBOT if reward.endswith("with_robot") else {}
    for ablation in ablations:
        changes |= _ABLATED.get(ablation, {})
    return replace(task.pretraining, **changes)


def encoder_numbers(model: RewardModel, held_out: Demonstrations) -> dict[str, float]:
    """Kendall's tau, three-way cycle consistency (0 with fewer than three) and value-order correlation."""
    embeddings = demonstration_embeddings(model, held_out)
    rewards = demonstration_rewards(model, held_out)
    lengths = held_out.lengths
    return {
        "kendall_tau": kendall_tau(embeddings, lengths) if len(held_out) >= 2 else 0.0,
        "cycle_consistency": cycle_consistency(embeddings, lengths) if len(held_out) >= 3 else 0.0,
        "value_order_correlation": float(np.mean(value_order_correlation(rewards, lengths))),
    }


@cache
def audit_scenes(task: Task, seed: int) -> Landscape:
    """The scenes of an audit; drawing them takes longer than judging a reward by them."""
    return task.landscape(stage_key(seed, LANDSCAPE))


def refuse_undrawn(task: Task, reward: str) -> None:
    """Says early that a policy cannot be trained on pixels of a task that no program can draw.

    Raises:
      ValueError: the reward is `xirl`, and the task has no `picture`.
    """
    if reward == "xirl":
        jax.eval_shape(lambda key: task.picture(task.reset(key).pipeline_state, 8), jax.random.key(0))


def picture_of(task: Task, model: RewardModel) -> Picture | None:
    """What draws a state for a reward of pictures; None for one of graphs."""
    return None if model.picture_size is None else _drawing(task, model.picture_size)


@cache
def _drawing(task: Task, size: int) -> Picture:
    """One and the same function for a task and size: compiled programs are known by it."""
    return partial(task.picture, size=size)


def audit_reward(run: Run, task: Task, model: RewardModel, demonstrations: Demonstrations, seed: int) -> dict[str, Any]:
    """Audits the reward away from the demonstrations it was learned from, draws it, and finds stages of held-out ones.

    Returns:
      the audit's numbers; how the reward tells successes from failures, if there are any; how well stages of held-out
      successes meet their true events, if they have them.
    """
    report = audit(model, audit_scenes(task, seed), picture_of(task, model))
    plots.landscape(report, run.figures / "landscape.png")
    held_out = demonstrations.successes().split(0.75, seed)[1]
    rewards = np.asarray(demonstration_rewards(model, held_out))
    plots.reward_over_time(
        rewards,
        held_out.lengths,
        held_out.events,
        held_out.event_names,
        held_out.frame_rate,
        run.figures / "reward_on_demonstrations.png",
        "Learned reward on held-out demonstrations",
    )
    numbers = {**report.numbers(), "trajectory_scores": trajectory_scores(model, demonstrations)}
    if not demonstrations.success.all():
        failed = demonstrations.select(~demonstrations.success)
        # Successes that the encoder saw are not asked whether they look like successes.
        numbers["discrimination"] = discrimination(
            np.concatenate([rewards, np.asarray(demonstration_rewards(model, failed))]),
            np.concatenate([held_out.lengths, failed.lengths]),
            np.concatenate([held_out.success, failed.success]),
        )
    found = demonstration_stages(model, held_out, STAGE_METHODS[0])
    write_json(run.path / "stages.json", {"method": STAGE_METHODS[0], **found})
    return {**numbers, "stages": found.get("judged")}


def demonstration_stages(model: RewardModel, demonstrations: Demonstrations, method: str) -> dict[str, Any]:
    """Boundaries of every demonstration's stages, in frames and seconds; judged by its true events where it has them.

    Raises:
      ValueError: an unknown method.
    """
    if method not in STAGE_METHODS:
        raise ValueError(f"unknown method {method!r}; known methods: {', '.join(STAGE_METHODS)}")
    lengths = [int(length) for length in demonstrations.lengths]
    if method == "change_points":
        profiles = np.asarray(demonstration_rewards(model, demonstrations))
        find = stages.change_points
    else:
        profiles = np.asarray(demonstration_embeddings(model, demonstrations))
        find = stages.uvd if method == "uvd" else partial(stages.rests, distance=1 / float(model.kappa))
    found = [find(profile[:length]) for profile, length in zip(profiles, lengths, strict=True)]
    kinds = demonstrations.kinds
    rows = [
        {
            "length": length,
            "kind": None if kinds is None else str(kinds[index]),
            "boundaries": boundaries,
            "seconds": [frame / demonstrations.frame_rate for frame in boundaries],
        }
        for index, (boundaries, length) in enumerate(zip(found, lengths, strict=True))
    ]
    if demonstrations.events is None:
        return {"stages": rows}
    true = [stages.true_boundaries(*pair) for pair in zip(demonstrations.events, lengths, strict=True)]
    return {"stages": rows, "judged": stages.judge(found, true, demonstrations.lengths)}


def load_reward(run: Run, config: EncoderConfig, task: Task, persistent: bool = True) -> RewardModel:
    """The frozen reward saved in a run's directory.

    Raises:
      RunError: there is none, or it does not fit an encoder of these sizes.
    """

    def template() -> RewardModel:
        zero = jnp.zeros((), jnp.float32)
        params = init_encoder(jax.random.key(0), config, task.objects.num_classes, task.objects.num_slots)
        goal = jnp.zeros(config.embedding, jnp.float32)
        return RewardModel(params, goal, *[zero] * 6, persistent, config.picture_size)

    return load_tree(run.path / "encoder.npz", jax.eval_shape(template))


def saved_reward(run: Run, settings: Settings, task: Task) -> Any:
    """The reward parameters of a run of `train`: those it saved, or tau for `env`; see `load_reward` for errors."""
    if settings.reward == "env":
        return np.float32(settings.pretrain.tau)
    config = settings.pretraining
    return load_reward(run, config.encoder, task, config.persistent)


def wrapper_of(reward: str) -> type[EnvironmentReward]:
    """What pays a reward: a wrapper around the task that takes the reward's parameters."""
    return {"env": EnvironmentReward, "xirl": PixelReward}.get(reward, GraphReward)


@cache
def environment_of(task: Task, reward: str) -> Callable[[Any], Any]:
    """The function from reward parameters to an environment; parameters are a `RewardModel`, or tau for `env`.

    One and the same function for a task and reward: compiled programs are known by it.
    """
    wrapper = wrapper_of(reward)
    return lambda reward_params: wrapper(task, reward_params)


def ppo_settings(task: Task, settings: Settings) -> tuple[PPOConfig, PPOHyper]:
    """PPO's static sizes and traced floats for a run."""
    config = replace(settings.sizes.ppo, episode_length=task.episode_length)
    return config, replace(settings.ppo, decay_updates=float(settings.sizes.updates))


def load_policy(run: Run, task: Task, settings: Settings, reward_params: Any) -> Any:
    """The policy saved in a run's directory.

    Raises:
      RunError: there is none, or it does not fit the settings' networks.
    """
    config, _ = ppo_settings(task, settings)
    make_env = environment_of(task, settings.reward)

    def template() -> Any:
        return ppo.policy_params(ppo.init(config, make_env, reward_params, jax.random.key(0)))

    return load_tree(run.path / "policy.npz", jax.eval_shape(template))


def evaluate_policy(
    task: Task, settings: Settings, reward_params: Any, policy: Any, episodes: int, seed: int
) -> dict[str, Any]:
    """Success rate, mean score and mean return of the deterministic policy over unseen episodes."""
    config, _ = ppo_settings(task, settings)
    make_env = environment_of(task, settings.reward)
    outcomes = evaluate(config, make_env, reward_params, policy, stage_key(seed, _EVALUATION), episodes)
    return {
        "success_rate": float(jnp.mean(outcomes["success"])),
        "mean_score": float(jnp.mean(outcomes["score"])),
        "episodes": episodes,
        "mean_return": float(jnp.mean(outcomes["episode_return"])),
        "seed": seed,
    }
