"""All rewards that a policy can be trained on, one row each; a new method is a new row in `METHODS`.

Plain Python, so that commands start without JAX.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Literal

from graphrl_jax.encoder.config import ActivityRule, Kind
from graphrl_jax.pretrain.config import PretrainHyper

Needs = Literal["nothing", "graphs", "images"]
ALL_FLOATS = tuple(one.name for one in fields(PretrainHyper))


@dataclass(frozen=True)
class Ablation:
    """A part of a method that is left out.

    Attributes:
      floats: values of `PretrainHyper` fields that the ablation sets.
      edges: keep offsets and distances on the edges.
      activity: rule by which an object becomes active; None keeps the default.
    """

    floats: Mapping[str, float] = field(default_factory=dict)
    edges: bool = True
    activity: ActivityRule | None = None


_TAU_PER_FRAME = 0.02
"""Threshold of the rules that compare an object with the previous frame, in box diagonals."""
ABLATIONS = {
    "reconstruction": Ablation({"reconstruction_weight": 0.0}),
    "activity": Ablation({"alpha": 1.0}),
    "displacement": Ablation({"tau": _TAU_PER_FRAME}, activity="frame_motion"),
    "persistence": Ablation({"tau": _TAU_PER_FRAME}, activity="momentary"),
    "edges": Ablation(edges=False),
}


@dataclass(frozen=True)
class Method:
    """A row of `METHODS`.

    Attributes:
      label: name of the method in tables.
      needs: input of the reward in every step: nothing (not learned), graphs or images; it selects the environment
        wrapper (`rl.wrappers.WRAPPERS`).
      encoder: kind of the encoder; None if no reward is learned.
      overrides: values of `PretrainHyper` fields that the method sets.
      floats: fields of `PretrainHyper` that affect the method; a run or a sweep may set these.
      ablations: names in `ABLATIONS` that affect the method.
    """

    label: str
    needs: Needs
    encoder: Kind | None = None
    overrides: Mapping[str, float] = field(default_factory=dict)
    floats: tuple[str, ...] = ALL_FLOATS
    ablations: tuple[str, ...] = ()


WITH_ROBOT = {"suppress_robot": 0.0, "robot_messages": 1.0}
"""A robot in the pooling also sends messages."""
_GRAPHIRL = {"alpha": 1.0, "reconstruction_weight": 0.0, "robot_messages": 0.0}
"""GraphIRL uses TCC alone, a plain mean and, w/o robot, no node for the robot."""
_GRAPHIRL_FLOATS = tuple(name for name in ALL_FLOATS if name not in ("alpha", "bumped_before"))
"""A plain mean weighs objects alike, moved or not."""
_IMAGE_FLOATS = (
    "learning_rate", "final_learning_rate", "warmup", "weight_decay", "max_grad_norm", "tau", "temperature",
    "tcc_weight", "even", "exponent", "rearranged", "bumped", "approach", "in_order",
)  # fmt: skip
"""Images do not show what has moved before."""

METHODS: dict[str, Method] = {
    "graph": Method("graph reward, w/o robot", "graphs", "message_passing", ablations=tuple(ABLATIONS)),
    "graph_with_robot": Method(
        "graph reward, w/ robot", "graphs", "message_passing", overrides=WITH_ROBOT, ablations=tuple(ABLATIONS)
    ),
    "graphirl": Method(
        "GraphIRL, w/o robot",
        "graphs",
        "interaction",
        overrides=_GRAPHIRL,
        floats=_GRAPHIRL_FLOATS,
        ablations=("displacement", "persistence"),
    ),
    "graphirl_with_robot": Method(
        "GraphIRL, w/ robot",
        "graphs",
        "interaction",
        overrides=_GRAPHIRL | WITH_ROBOT,
        floats=_GRAPHIRL_FLOATS,
        ablations=("displacement", "persistence"),
    ),
    # XIRL learns from videos as they are; a task that can draw boxes lets it learn from rearrangements, too.
    "xirl": Method("XIRL (pixels)", "images", "pixels", overrides={"rearranged": 0.0}, floats=_IMAGE_FLOATS),
    # No reward is learned, but the policy observes activity.
    "env": Method("environmental reward, with the reach term", "nothing", floats=("tau",)),
}


def method_named(name: str) -> Method:
    """The row of `METHODS` with this name.

    Raises:
      ValueError: there is none; the message lists the known names.
    """
    if name not in METHODS:
        raise ValueError(f"unknown reward {name!r}; known rewards: {', '.join(METHODS)}")
    return METHODS[name]
