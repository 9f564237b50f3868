"""Rows of Table I: rewards, each learned one with rearranged demonstrations and in the paper's way."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from graphrl_jax.experiment.methods import METHODS

PAPER = {"rearranged": 0.0, "even": 0.0, "exponent": 1.0}
"""The paper's way: demonstrations as they are, the goal from their last frames, Eq. 3 without an exponent."""
IMAGES = "xirl"
"""The method whose encoders look at images; it has fewer seeds, because these are slow."""


@dataclass(frozen=True)
class Row:
    """A reward of a table.

    Attributes:
      method: name in `METHODS`.
      seeds: how many the whole table has.
      floats: values of `PretrainHyper` fields in which the row differs from the method's defaults.
    """

    method: str
    seeds: int = 5
    floats: Mapping[str, float] = field(default_factory=dict)

    @property
    def learned(self) -> bool:
        """Whether the row has an encoder."""
        return METHODS[self.method].encoder is not None

    @property
    def paper(self) -> bool:
        """Whether the reward is learned in the paper's way."""
        return self.floats == PAPER


def _ways(method: str) -> dict[str, Row]:
    seeds = 3 if method == IMAGES else 5
    ours = {"rearranged": 1.0} if method == IMAGES else {}
    return {method: Row(method, seeds, ours), f"{method}_paper": Row(method, seeds, PAPER)}


LEARNED = ("graph", "graphirl", "graph_with_robot", "graphirl_with_robot", IMAGES)
"""Methods with an encoder, in the order in which they are trained."""
ROWS: dict[str, Row] = {"env": Row("env"), **{name: row for method in LEARNED for name, row in _ways(method).items()}}
"""Rows by name, in the order in which they are trained."""
OURS = "graph"
"""The row that others are compared with."""


def label_of(name: str) -> str:
    """What a row is called in tables."""
    row = ROWS[name]
    way = ", the paper's way" if row.paper else ""
    return METHODS[row.method].label + way
