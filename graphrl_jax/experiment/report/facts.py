"""The facts of a run: what its folder holds, as values. A run may be unfinished, and files may be missing."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from graphrl_jax.experiment.experiment import load_demonstrations
from graphrl_jax.experiment.run_directory import Run, RunError
from graphrl_jax.experiment.settings import Settings
from graphrl_jax.experiment.train_encoder import EncoderJob
from graphrl_jax.reward.card import Card, read_card
from graphrl_jax.reward.model import RewardModel, demonstration_rewards
from graphrl_jax.storage import StorageError, read_json
from graphrl_jax.viz.run_page import HeldOut

COMMANDS = ("train", "pretrain")
_FIGURES = ("landscape", "reward_on_rollouts", "reward_on_demonstrations")


@dataclass(frozen=True)
class Facts:
    """A run as its folder tells it.

    Attributes:
      run: the folder.
      command: that made it, `train` or `pretrain`.
      commit: of the code; None if it was not in a repository.
      settings: of the run.
      summary: of the finished run; empty before.
      encoder: metrics of the encoder and its audit; empty if there are none yet.
      ppo, pretrain: lines of metrics.jsonl.
      subtasks: content of subtasks.json; empty without one.
      held_out: progress in held-out demonstrations; None if it cannot be computed.
      no_held_out: why it cannot be computed, one sentence.
    """

    run: Run
    command: str
    commit: str | None
    settings: Settings
    summary: Mapping[str, Any]
    encoder: Mapping[str, Any]
    ppo: list[dict[str, Any]]
    pretrain: list[dict[str, Any]]
    subtasks: Mapping[str, Any]
    held_out: HeldOut | None
    no_held_out: str

    @property
    def learns_reward(self) -> bool:
        """Whether the run learns a reward."""
        return self.settings.method.encoder is not None

    @property
    def trains_policy(self) -> bool:
        """Whether the run trains a policy."""
        return self.command == "train"

    @property
    def evaluated(self) -> bool:
        """Whether the policy was evaluated."""
        return "success_rate" in self.summary

    @property
    def updates(self) -> int:
        """Updates of PPO so far."""
        return int(max((record.get("update", 0) for record in self.ppo), default=0))

    @cached_property
    def video(self) -> Path | None:
        """The video of the run's end, else the newest one of an evaluation."""
        rollout = self.run.path / "rollout.mp4"
        others = sorted(self.run.path.glob("evaluation_*.mp4"), key=lambda path: path.stat().st_mtime)
        return rollout if rollout.exists() else others[-1] if others else None

    @cached_property
    def figures(self) -> dict[str, Path]:
        """The figures that there are, by name."""
        paths = {name: self.run.figures / f"{name}.png" for name in _FIGURES}
        return {name: path for name, path in paths.items() if path.exists()}

    @cached_property
    def card(self) -> Card | None:
        """The card of the reward model, if there is one."""
        try:
            return read_card(self.run.path)
        except StorageError:
            return None


def read_facts(path: Path) -> Facts:
    """The facts of the run in a folder.

    Raises:
      RunError, StorageError: the folder holds no run of `train` or `pretrain`, or a file of it is damaged.
    """
    run = Run(path)
    settings = run.settings(*COMMANDS)
    about = read_json(path / "config.json")
    summary = _object(path / "summary.json")
    encoder = summary if about["command"] == "pretrain" else summary.get("encoder") or _object(path / "encoder.json")
    held_out, why = _held_out(run, settings)
    return Facts(
        run=run,
        command=about["command"],
        commit=about.get("commit"),
        settings=settings,
        summary=summary,
        encoder=encoder,
        ppo=run.records("ppo"),
        pretrain=run.records("pretrain"),
        subtasks=_object(path / "subtasks.json"),
        held_out=held_out,
        no_held_out=why,
    )


def _object(path: Path) -> dict[str, Any]:
    """The object in a JSON file; empty if there is no file."""
    if not path.exists():
        return {}
    content = read_json(path)
    if not isinstance(content, dict):
        raise RunError(f"{path} holds {type(content).__name__}; allowed: an object")
    return content


def _held_out(run: Run, settings: Settings) -> tuple[HeldOut | None, str]:
    """Progress in the demonstrations that the encoder was not trained on, or why it cannot be computed."""
    kept = run.path / "demonstrations.npz"
    file = kept if kept.exists() or settings.demos is None else Path(settings.demos)
    try:
        model = RewardModel.load(run.path)
        card = model.card
        assert card is not None
        demos = load_demonstrations(file, card.objects, card.frame_rate, card.task)
        job = EncoderJob(run, demos, settings.pretrain, settings.seed)
        if len(job.split[0]) != card.demonstrations:
            return None, f"{file} holds other demonstrations than those that the encoder was trained on"
        unseen = job.unseen
        rewards = np.asarray(demonstration_rewards(model, unseen))
    except ValueError as error:
        return None, str(error)
    kinds = unseen.kinds if unseen.kinds is not None else np.where(unseen.success, "success", "failure")
    real = [row[:length] for row, length in zip(rewards, unseen.lengths.tolist(), strict=True)]
    return HeldOut(
        progress=[np.clip(1 + row, 0, 1) for row in real],
        success=unseen.success,
        like_success=np.array([row[-1] >= card.end_reward for row in real]),
        kinds=[str(kind) for kind in kinds],
        frame_rate=unseen.frame_rate,
        level=float(np.clip(1 + card.end_reward, 0, 1)),
    ), ""
