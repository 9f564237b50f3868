"""The card of a reward model: what it takes, and what it has learned from. It travels with the model in one folder:

config.json          the card, beside whatever else the folder's maker keeps there
model.safetensors    the parameters
README.md            the card and the model's numbers, for people; its head is for the Hugging Face Hub
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from graphrl_jax.encoder.config import ActivityRule, EncoderConfig
from graphrl_jax.graph import ObjectTable
from graphrl_jax.runtime import versions
from graphrl_jax.storage import StorageError, from_plain, read_json, write_atomically, write_json

CONFIG, MODEL, README = "config.json", "model.safetensors", "README.md"
_ENTRY = "reward_model"
_MEASURES = {
    "value_order_correlation": ("rank correlation of the reward with time in held-out demonstrations", "above 0.9"),
    "pair_accuracy": ("of two scenes, how often the one with less left to do has the higher reward", "above 0.8"),
    "finished_above_unfinished": (
        "how often a finished scene has a higher reward than an unfinished one",
        "above 0.95",
    ),
    "within_above_beside": ("how often a finished scene has a higher reward than one just short of it", "above 0.9"),
    "maxima_inside": ("how often the place with the highest reward for an object is in its goal", "above 0.95"),
    "bump_bonus": ("reward that is paid if all objects count as moved", "near 0"),
    "kendall_tau": ("whether like frames of two held-out demonstrations come in the same order", "above 0.8"),
    "cycle_consistency": ("share of frames that are their own match by way of two other demonstrations", "high"),
    "pretrain_s": ("seconds of pretraining", ""),
}
"""What the measures of an audit mean, and which values are good."""


@dataclass(frozen=True)
class Card:
    """What a reward model takes, and what it has learned from; all static.

    Attributes:
      objects: the object in each node slot.
      frame_rate: frames per second.
      encoder: kind and sizes of the encoder.
      activity: rule by which an object becomes active.
      task: name of the task.
      source: of the demonstrations.
      demonstrations: number of successes that it has learned from.
      end_reward: a recording that ends with at least this reward looks like success; 95 % of the successes end above it
        by at least a tenth of the way from start to goal.
    """

    objects: ObjectTable
    frame_rate: float
    encoder: EncoderConfig
    activity: ActivityRule
    task: str
    source: str
    demonstrations: int
    end_reward: float


def write_card(folder: Path, card: Card, numbers: Mapping[str, Any]) -> None:
    """Writes the card into a folder's config.json, whose other entries stay, and README.md.

    Args:
      folder: folder of the model.
      card: the card.
      numbers: measures of the model by name, such as its audit; those that are no numbers are left out. The text has a
        meaning for those of pretraining.
    """
    path = folder / CONFIG
    others = read_json(path) if path.exists() else {}
    write_json(path, {**others, _ENTRY: asdict(card)})
    text = _text(card, numbers)
    write_atomically(folder / README, lambda temporary: temporary.write_text(text))


def read_card(folder: Path) -> Card:
    """The card of the reward model in a folder.

    Raises:
      StorageError: there is none, or it is damaged; the message names the file and the field.
    """
    path = folder / CONFIG
    if not path.exists():
        raise StorageError(f"{path} is missing: {folder} holds no reward model")
    content = read_json(path)
    if not isinstance(content, Mapping) or _ENTRY not in content:
        raise StorageError(f"{path} has no {_ENTRY}: {folder} holds no reward model, or one that is not finished")
    try:
        return from_plain(Card, content[_ENTRY], str(path))
    except ValueError as error:
        raise StorageError(f"{path}: {error}" if str(path) not in str(error) else str(error)) from error


def without_card(config: Mapping[str, Any]) -> dict[str, Any]:
    """The entries of a config.json that are not the card's."""
    return {name: value for name, value in config.items() if name != _ENTRY}


def _text(card: Card, numbers: Mapping[str, Any]) -> str:
    objects = card.objects
    kinds = zip(objects.is_robot, objects.is_fixture, objects.is_articulated, strict=True)
    names = [
        "robot" if robot else "fixture" if fixture else "articulated" if articulated else "free"
        for robot, fixture, articulated in kinds
    ]
    classes = [objects.class_names[number] for number in objects.class_ids]
    rows = [f"| {name} | {label} | {kind} |" for name, label, kind in zip(objects.names, classes, names, strict=True)]
    measured = [_measure(name, value) for name, value in numbers.items() if type(value) in (int, float)]
    used = ", ".join(f"{name} {version}" for name, version in versions().items())
    return f"""---
library_name: graphrl_jax
pipeline_tag: robotics
tags:
- reward-model
- jax
---

# Reward model for {card.task}

It gives each frame of a recording a reward: about -1 at the start of the task, 0 at its goal. It takes the objects'
boxes at {card.frame_rate:g} frames per second{_of_images(card)}.

It has learned from {card.demonstrations} successful demonstrations ({card.source}). A recording that ends with a reward
of at least {card.end_reward:.3g} looks like success.

| object | class | kind |
|---|---|---|
{chr(10).join(rows)}

| measure | value | good | meaning |
|---|---|---|---|
{chr(10).join(measured)}

```python
from graphrl_jax import RewardModel

model = RewardModel.load("this/folder")  # or owner/name of a model on the Hugging Face Hub
rewards = model.rewards(boxes, mask)  # (T, N, 4) and (T, N) -> (T,)
```

Encoder: {card.encoder.kind}, {card.encoder.embedding} dimensions. Made with {used}.
"""


def _measure(name: str, value: float) -> str:
    """A measure's row."""
    meaning, good = _MEASURES.get(name, ("", ""))
    return f"| {name} | {value:.4g} | {good} | {meaning} |"


def _of_images(card: Card) -> str:
    size = card.encoder.image_size
    return "" if size is None else f", as images of {size} x {size} pixels"
