"""All settings of a run: composed from defaults, preset, task, method and request, and stored as JSON."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from typing import Any

import jax

from graphrl_jax.experiment.methods import ABLATIONS, Method, method_named
from graphrl_jax.experiment.presets import Preset, preset_named
from graphrl_jax.experiment.ranges import refuse_no_loss, refuse_no_retreat, refuse_outside, refuse_switched_off
from graphrl_jax.pretrain.config import PretrainConfig, PretrainHyper
from graphrl_jax.rl.config import PPOConfig, PPOHyper
from graphrl_jax.storage import from_plain
from graphrl_jax.task import Task, TrainingSize


@dataclass(frozen=True)
class Settings:
    """Complete settings of a run, made by `compose`; fields that were not requested have their defaults.

    Attributes:
      task: registered name.
      reward: name of a row in `methods.METHODS`.
      preset: name of the preset that the sizes are based on.
      seed: source of all randomness.
      demos: path of a demonstration file, or None for expert demonstrations.
      demonstrations: number of expert demonstrations; the audit adds a quarter as many failures.
      updates: PPO updates.
      updates_per_chunk: updates per compiled call; checkpoints and log lines are written once per chunk.
      episodes: episodes of the final evaluation.
      stop_at: the training of a single policy ends early once it solves this share of as many unseen episodes, others
        than the final ones, twice in a row; 0 for never.
      engine: physics engine of the task, or None for the fastest on the device.
      pretrain_config: sizes of pretraining.
      pretrain: floats of pretraining.
      ppo_config: sizes of PPO.
      ppo: floats of PPO.

    Raises:
      ValueError: a value that is not allowed; the message names the field.
    """

    task: str
    reward: str
    preset: str
    seed: int
    demos: str | None
    demonstrations: int
    updates: int
    updates_per_chunk: int
    episodes: int
    stop_at: float
    engine: str | None
    pretrain_config: PretrainConfig
    pretrain: PretrainHyper
    ppo_config: PPOConfig
    ppo: PPOHyper

    def __post_init__(self) -> None:
        method_named(self.reward)
        preset_named(self.preset)
        for name in ("demonstrations", "updates", "updates_per_chunk", "episodes"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} is {getattr(self, name)}; allowed: 1 or more")
        if not 0 <= self.stop_at <= 1:
            raise ValueError(f"stop_at is {self.stop_at}; allowed: 0 to 1")
        for group in ("pretrain", "ppo"):
            for name, value in asdict(getattr(self, group)).items():
                refuse_outside(f"{group}.{name}", value)

    @property
    def method(self) -> Method:
        """The row of the reward in `methods.METHODS`."""
        return method_named(self.reward)

    @property
    def step_discount(self) -> float:
        """PPO's discount per control step; `ppo.discount` is per decision."""
        return self.ppo.discount ** (1 / self.ppo_config.decision_steps)

    @property
    def image_size(self) -> int | None:
        """Edge of the reward's input images in pixels; None without images."""
        return self.pretrain_config.encoder.image_size


def compose(
    task: Task,
    reward: str = "graph",
    preset: str = "cpu",
    seed: int = 0,
    demos: str | None = None,
    ablations: Sequence[str] = (),
    updates: int | None = None,
    engine: str | None = None,
    pretrain: Mapping[str, Any] | None = None,
    ppo: Mapping[str, Any] | None = None,
    stop_at: float = 0.0,
) -> Settings:
    """Settings of a run. Requested values override those of the method, then of the task, then of the preset.

    Args:
      task: task of the run.
      reward: name of a row in `methods.METHODS`.
      preset: name in `presets.PRESETS`.
      seed: source of all randomness.
      demos: path of a demonstration file, or None.
      ablations: names in `methods.ABLATIONS`.
      updates: PPO updates; default: the task's for this preset, else the preset's.
      engine: physics engine that was asked for.
      pretrain: requested values of `PretrainHyper` and `PretrainConfig` fields.
      ppo: requested values of `PPOHyper` and `PPOConfig` fields.
      stop_at: see `Settings`.

    Raises:
      ValueError: an unknown name, a value that is not allowed, or a request that does not affect this reward.
    """
    method, sizes = method_named(reward), preset_named(preset)
    size = task.training_sizes.get(preset, TrainingSize(sizes.updates, {}))
    updates = size.updates if updates is None else updates
    floats, config_fields = _shared_out("pretrain", pretrain, PretrainHyper, PretrainConfig)
    ppo_floats, ppo_fields = _shared_out("ppo", ppo, PPOHyper, PPOConfig)
    task_floats, task_fields = _shared_out("ppo", size.ppo, PPOHyper, PPOConfig)
    _refuse_useless(reward, method, floats if method.encoder else floats | config_fields)
    hyper = _pretrain_floats(task, reward, ablations, floats)
    refuse_switched_off(hyper, pretrain or {})
    episode = {"episode_length": task.episode_length, "decision_steps": task.decision_steps}
    ppo_config = replace(sizes.ppo_config, **_with_nodes(task, episode | task_fields | ppo_fields))
    refuse_no_retreat(ppo_config, task)
    return Settings(
        task=task.name,
        reward=reward,
        preset=preset,
        seed=seed,
        demos=demos,
        demonstrations=sizes.demonstrations,
        updates=updates,
        updates_per_chunk=sizes.updates_per_chunk,
        episodes=sizes.episodes,
        stop_at=stop_at,
        engine=engine,
        pretrain_config=replace(_pretrain_config(sizes, method, ablations), **config_fields),
        pretrain=hyper,
        ppo_config=ppo_config,
        ppo=PPOHyper(**{"decay_updates": float(updates)} | task_floats | ppo_floats),
    )


def _refuse_useless(reward: str, method: Method, asked: Mapping[str, Any]) -> None:
    """Refuses fields of pretraining that are asked for and change nothing about the reward."""
    for name in asked:
        if name not in method.floats:
            allowed = ", ".join(method.floats)
            raise ValueError(f"pretrain.{name} changes nothing about reward {reward}; allowed: {allowed}")


def _with_nodes(task: Task, asked: Mapping[str, Any]) -> dict[str, Any]:
    """The fields of `PPOConfig` that are asked for, with the numbers of nodes and features for a policy of a set."""
    if asked.get("policy") != "set":
        return dict(asked)
    nodes = jax.eval_shape(lambda key: task.nodes(task.reset(key)), jax.random.key(0))
    return {**asked, "nodes": nodes.shape}


def _pretrain_floats(task: Task, reward: str, ablations: Sequence[str], asked: Mapping[str, float]) -> PretrainHyper:
    """The floats of pretraining: those asked for over those of ablations, method and task."""
    method = method_named(reward)
    ablated = _ablated_floats(reward, method, ablations)
    for name in ablated.keys() & asked:
        raise ValueError(f"pretrain.{name} is asked for, but an ablation of {', '.join(ablations)} sets it")
    hyper = PretrainHyper(**{**task.pretrain_overrides, **method.overrides, **ablated, **asked})
    refuse_no_loss(hyper, method)
    return hyper


def _pretrain_config(sizes: Preset, method: Method, ablations: Sequence[str]) -> PretrainConfig:
    """The preset's sizes with the method's encoder and the ablations."""
    if method.encoder is None:
        return sizes.pretrain_config["graphs"]
    config = sizes.pretrain_config[method.needs]
    left_out = [ABLATIONS[name] for name in ablations]
    encoder = replace(config.encoder, kind=method.encoder, edges=all(one.edges for one in left_out))
    rules = {name: ABLATIONS[name].activity for name in ablations if ABLATIONS[name].activity}
    if len(rules) > 1:
        raise ValueError(f"ablations {', '.join(rules)} each set the rule of activity; allowed: one of them")
    return replace(config, encoder=encoder, activity=next(iter(rules.values()), config.activity))


def _ablated_floats(reward: str, method: Method, ablations: Sequence[str]) -> dict[str, float]:
    """Floats that ablations set, after a check that all ablations are known and affect the reward."""
    floats: dict[str, float] = {}
    for name in ablations:
        if name not in ABLATIONS:
            raise ValueError(f"unknown ablation {name!r}; known ablations: {', '.join(ABLATIONS)}")
        if name not in method.ablations:
            raise ValueError(f"ablation {name!r} changes nothing about reward {reward!r}")
        floats |= ABLATIONS[name].floats
    return floats


def _shared_out(group: str, values: Mapping[str, Any] | None, *kinds: type) -> list[dict[str, Any]]:
    """The requested values of a group as one dict per config class, after a check that all names are known."""
    values = values or {}
    known = [name for kind in kinds for name in _names(kind)]
    for name in values:
        if name not in known:
            raise ValueError(f"unknown field {group}.{name}; known fields: {', '.join(known)}")
    return [{name: values[name] for name in _names(kind) if name in values} for kind in kinds]


def _names(kind: type) -> list[str]:
    """Names of the fields of a dataclass."""
    return [one.name for one in fields(kind)]


def as_json(settings: Settings) -> dict[str, Any]:
    """Settings as a dict for JSON."""
    return asdict(settings)


def from_json(values: Mapping[str, Any]) -> Settings:
    """The inverse of `as_json`.

    Raises:
      ValueError: a field is missing, unknown, or has a value that is not allowed; the message names it.
    """
    return from_plain(Settings, values, "settings")
