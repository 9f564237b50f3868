"""Writes docs/configuration.md from the code: `python -m docs.generate`. A test fails if the two disagree."""

import dataclasses
import typing
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from graphrl_jax.cli.options import field_help
from graphrl_jax.cli.requests import FOLLOWING, RESOLVED
from graphrl_jax.encoder.config import EncoderConfig, PixelConfig
from graphrl_jax.experiment.methods import ABLATIONS, METHODS
from graphrl_jax.experiment.presets import PRESETS, Preset
from graphrl_jax.pretrain.config import PretrainConfig, PretrainHyper
from graphrl_jax.rl.config import PPOConfig, PPOHyper
from graphrl_jax.task import Task
from tasks.match_regions.task import MatchRegions
from tasks.shoes_in_box.task import ShoesInBox

PAGE = Path(__file__).parent / "configuration.md"
TASKS: tuple[type[Task], ...] = (MatchRegions, ShoesInBox)
BEGIN, END = "<!-- fields: written by a script from the code -->\n", "<!-- end of fields -->"


def fields_of(kind: type, values: Mapping[str, Any] | None = None, options: str | None = None) -> str:
    """A class's fields as a table.

    Args:
      kind: a config class.
      values: instances whose values are shown, by column; the class's defaults, if left out.
      options: prefix of the command line's options, where there are any.
    """
    helps, values = field_help(kind), values or {"default": kind()}
    rows = []
    for field in dataclasses.fields(kind):
        is_option = options is not None and field.name not in RESOLVED
        name = _option(f"{options}.{field.name}") if is_option else f"`{field.name}`"
        shown = [FOLLOWING.get(field.name) or _value(getattr(one, field.name)) for one in values.values()]
        rows.append([name, *shown, helps[field.name]])
    return table(["field", *values, "meaning"], rows)


def table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """A markdown table."""
    lines = [list(head), *(list(row) for row in rows)]
    lines.insert(1, ["---"] * len(lines[0]))
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines) + "\n"


def _value(value: Any) -> str:
    """A field's value as a cell."""
    if dataclasses.is_dataclass(value):
        return "see below"
    if isinstance(value, str):
        return value
    return " ".join(map(str, value)) if isinstance(value, tuple) else f"{value}"


def methods() -> str:
    """Every row of `METHODS`, and what it sets and allows."""
    rows = []
    for name, method in METHODS.items():
        sets = ", ".join(f"{field} {value:g}" for field, value in method.overrides.items()) or "-"
        allowed = ", ".join(method.ablations) or "-"
        rows.append([f"`{name}`", method.label, method.needs, method.encoder or "-", sets, allowed])
    return table(["`--reward`", "label", "needs", "encoder", "sets", "ablations"], rows)


def ablations() -> str:
    """Every row of `ABLATIONS`."""
    rows = []
    for name, ablation in ABLATIONS.items():
        changes = [f"`pretrain.{field}` is {value:g}" for field, value in ablation.floats.items()]
        changes += [] if ablation.edges else ["`pretrain_config.encoder.edges` is False"]
        changes += [f"`pretrain_config.activity` is {ablation.activity}"] if ablation.activity else []
        rows.append([f"`{name}`", ", ".join(changes)])
    return table(["`--ablate`", "change"], rows)


def task_values() -> str:
    """What `TASKS` set, by preset."""
    rows = []
    for task in TASKS:
        values = {name: {"updates": size.updates} | dict(size.ppo) for name, size in task.training_sizes.items()}
        fixed = {"ppo.decision_steps": task.decision_steps} if task.decision_steps > 1 else {}
        fixed |= {f"pretrain.{field}": value for field, value in task.pretrain_overrides.items()}
        rows += [[task.name, _option(field), *len(PRESETS) * [_value(value)]] for field, value in fixed.items()]
        for field in dict.fromkeys(name for size in values.values() for name in size):
            shown = [_value(values.get(preset, {}).get(field, "-")) for preset in PRESETS]
            rows.append([task.name, _option(field if field == "updates" else f"ppo.{field}"), *shown])
    return table(["task", "field", *PRESETS], rows)


def _option(field: str) -> str:
    """A field as the option that sets it."""
    return f"`--{field.replace('_', '-')}`"


def preset_sizes() -> str:
    """What presets say beside the sizes of pretraining and PPO."""
    helps = field_help(Preset)
    names = [field.name for field in dataclasses.fields(Preset) if typing.get_type_hints(Preset)[field.name] is int]
    rows = [[f"`{name}`", *(_value(getattr(one, name)) for one in PRESETS.values()), helps[name]] for name in names]
    return table(["field", *PRESETS, "meaning"], rows)


def page() -> str:
    """Everything between the markers."""
    graphs = {name: preset.pretrain_config["graphs"] for name, preset in PRESETS.items()}
    images = {name: preset.pretrain_config["images"] for name, preset in PRESETS.items()}
    pixels = {name: config.encoder.pixels for name, config in images.items()}
    ppo = {name: preset.ppo_config for name, preset in PRESETS.items()}
    sections = {
        "Rewards": methods(),
        "Ablations": ablations(),
        "What tasks set": task_values(),
        "Sizes of a run, by preset": preset_sizes(),
        "Pretraining: floats": fields_of(PretrainHyper, options="pretrain"),
        "Pretraining: sizes, by preset": fields_of(PretrainConfig, graphs, "pretrain"),
        "Pretraining on images: sizes, by preset": fields_of(PretrainConfig, images, "pretrain"),
        "Encoder": fields_of(EncoderConfig),
        "Encoder of images, by preset": fields_of(PixelConfig, pixels),
        "PPO: floats": fields_of(PPOHyper, options="ppo"),
        "PPO: sizes, by preset": fields_of(PPOConfig, ppo, "ppo"),
    }
    return "\n" + "\n".join(f"## {title}\n\n{text}" for title, text in sections.items())


def with_fields(text: str) -> str:
    """The page with what stands between its markers written anew."""
    before, _, rest = text.partition(BEGIN)
    _, _, after = rest.partition(END)
    return before + BEGIN + page() + "\n" + END + after


if __name__ == "__main__":
    PAGE.write_text(with_fields(PAGE.read_text()))
