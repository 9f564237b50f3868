"""Options of commands: choices listed in the help, and every field of a config as an optional option."""

import dataclasses
import typing
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import docstring_parser
import tyro

LARGEST_SEED = 2**32 - 1
_METAVARS = {int: "INT", float: "FLOAT", bool: "{True,False}", str: "STR", tuple[int, ...]: "[INT [INT ...]]"}


def choice(names: Iterable[str]) -> Any:
    """An option that takes one of these names; the code that reads it reports other names."""
    return tyro.conf.arg(metavar=f"{{{','.join(names)}}}")


def optional(metavar: str, default: str) -> Any:
    """An optional option; the help shows `default` as its default."""
    return tyro.conf.arg(metavar=metavar, help_behavior_hint=f"(default: {default})")


def field_help(kind: type) -> dict[str, str]:
    """The description of each attribute in a class's docstring."""
    parsed = docstring_parser.parse(kind.__doc__ or "", style=docstring_parser.DocstringStyle.GOOGLE)
    return {one.arg_name: " ".join((one.description or "").split()) for one in parsed.params}


def overrides(
    name: str,
    kinds: Mapping[type, str],
    left_out: Iterable[str] = (),
    aliases: Mapping[str, str] | None = None,
    defaults: Mapping[str, str] | None = None,
) -> type:
    """A dataclass with every field of some config classes; fields are None unless given.

    Args:
      name: name of the new class.
      kinds: config classes, each with the help text of its defaults; "" shows each field's own default.
      left_out: fields that are not options.
      aliases: further names of options, by field.
      defaults: help texts of defaults, by field, that differ from the text of the class.
    """
    aliases, defaults, made = aliases or {}, defaults or {}, []
    for kind, default in kinds.items():
        helps, hints = field_help(kind), typing.get_type_hints(kind)
        for field in dataclasses.fields(kind):
            if field.name in left_out:
                continue
            option = tyro.conf.arg(
                metavar=_metavar(hints[field.name]),
                help=helps[field.name],
                help_behavior_hint=f"(default: {defaults.get(field.name) or default or field.default})",
                aliases=[aliases[field.name]] if field.name in aliases else None,
            )
            made.append((field.name, Annotated[_plain(hints[field.name]) | None, option], None))
    return dataclasses.make_dataclass(name, made, frozen=True)


def asked_for(options: Any) -> dict[str, Any]:
    """The fields of an `overrides` object that were given."""
    return {name: value for name, value in vars(options).items() if value is not None}


def _plain(hint: Any) -> Any:
    """The type to read: str for a Literal, because the config reports wrong values in one sentence."""
    return str if typing.get_origin(hint) is Literal else hint


def _metavar(hint: Any) -> str:
    names = typing.get_args(hint) if typing.get_origin(hint) is Literal else ()
    return f"{{{','.join(names)}}}" if names else _METAVARS[hint]


def refuse_useless(request: Any, names: Iterable[str], why: str) -> None:
    """Refuses options that were given and would change nothing.

    Args:
      request: the request.
      names: its fields that change nothing.
      why: what makes them useless; the message ends with it.

    Raises:
      ValueError: see above.
    """
    for name in names:
        for part in _given(request, name):
            raise ValueError(f"{option(name, part)} changes nothing {why}; leave it out")


def refuse_other(request: Any, own: Mapping[str, Any], where: Path) -> None:
    """Refuses options that were given and differ from what a run that is resumed has.

    Args:
      request: the request.
      own: what the run has, by field of the request; fields that are groups have a mapping.
      where: folder of the run.

    Raises:
      ValueError: see above.
    """
    for name, has in own.items():
        for part, asked in _given(request, name).items():
            kept = has if part is None else has[part]
            if _text(asked) != _text(kept):
                raise ValueError(
                    f"{option(name, part)} is {_text(asked)}, but {where} goes on with its own settings, "
                    f"{_text(kept)}; leave it out"
                )


def _given(request: Any, name: str) -> dict[str | None, Any]:
    """What was given of a field: the parts of a group by their names, or the field's own value by None."""
    value = getattr(request, name)
    if dataclasses.is_dataclass(value):
        return dict(asked_for(value))
    (usual,) = (field.default for field in dataclasses.fields(request) if field.name == name)
    return {} if value == usual else {None: value}


def option(name: str, part: str | None) -> str:
    """The option of a field, or of a part of a group."""
    return f"--{name if part is None else f'{name}.{part}'}".replace("_", "-")


def _text(value: Any) -> str:
    """A value as it is typed; JSON makes lists of tuples, and integers of some floats."""
    if isinstance(value, list | tuple):
        return " ".join(map(_text, value))
    return f"{value:g}" if isinstance(value, int | float) and not isinstance(value, bool) else str(value)


def refuse_existing(out: Path) -> None:
    """Refuses to overwrite a file.

    Raises:
      ValueError: the file exists.
    """
    if out.exists():
        raise ValueError(f"--out {out} exists already; choose another name")


def refuse_seeds(request: Any) -> None:
    """Refuses seeds that random numbers cannot start from.

    Raises:
      ValueError: `seed`, or one of the `seeds` from `first_seed` on, is out of range.
    """
    for name in ("seed", "first_seed"):
        first = getattr(request, name, 0)
        last = first + (getattr(request, "seeds", 1) - 1 if name == "first_seed" else 0)
        if first < 0 or last > LARGEST_SEED:
            option = name.replace("_", "-")
            upto = f" and the last seed {last}" if last > first else ""
            raise ValueError(f"--{option} is {first}{upto}; allowed: 0 to {LARGEST_SEED}")
