"""Random keys of run stages: one each, folded into the run's seed.

The randomness of a run stage therefore does not depend on which others ran.
"""

from enum import IntEnum

import jax


class RunStage(IntEnum):
    """Run stages that use randomness. The values define the random keys, so they must never change."""

    DEMONSTRATIONS = 0
    PRETRAIN = 1
    LANDSCAPE = 2
    POLICY = 3
    EVALUATION = 4
    RECORDING = 5
    GOAL = 6
    STARTS = 7


def stage_key(seed: int, stage: RunStage) -> jax.Array:
    """The typed key of a run stage."""
    return jax.random.fold_in(jax.random.key(seed), int(stage))
