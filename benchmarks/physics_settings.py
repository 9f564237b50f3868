"""What physics settings cost, and what they still can do: steps per second beside the expert's success.

    python -m benchmarks.physics_settings [--episodes 128] [--out FILE]

The expert was written for the default settings; a setting under which it grips, drags and releases as well, and faster,
would be the better default. Speed is that of the expert's whole rollout (physics dominates it), compiled beforehand.
"""

import time
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import tyro
from rich.console import Console
from rich.table import Table

from benchmarks.context import measured_on
from graphrl_jax.runtime import configure
from graphrl_jax.storage import write_json
from tasks.match_regions.expert import rollouts
from tasks.match_regions.model import Physics
from tasks.match_regions.state import score
from tasks.match_regions.task import MatchRegions

DEFAULT = Physics()
VARIANTS = {
    "default": DEFAULT,
    "2 sub-steps": replace(DEFAULT, substeps=2),
    "4 sub-steps": replace(DEFAULT, substeps=4),
    "2 iterations": replace(DEFAULT, iterations=2),
    "4 iterations": replace(DEFAULT, iterations=4, ls_iterations=8),
    "4 contact points": replace(DEFAULT, max_contact_points=4),
    "10 contact points": replace(DEFAULT, max_contact_points=10),
}


@dataclass(frozen=True)
class Options:
    """Speed and expert success of several physics settings.

    Attributes:
      episodes: episodes of the expert per setting, side by side.
      out: where the numbers go.
    """

    episodes: int = 256
    out: Path = Path("benchmarks/results/physics_settings.json")


def measure(physics: Physics, episodes: int) -> dict[str, float]:
    """Control steps per second, and how many of the expert's episodes succeed."""
    task, kinds = MatchRegions(physics=physics), jnp.zeros(episodes, jnp.int32)
    jax.block_until_ready(rollouts(task, jax.random.key(1), kinds))
    started = time.perf_counter()
    frames, worlds, _ = jax.block_until_ready(rollouts(task, jax.random.key(2), kinds))
    seconds = time.perf_counter() - started
    success = np.asarray(jax.vmap(score)(frames[:, -1], worlds)) == 1.0
    return {"steps_per_s": episodes * task.episode_length / seconds, "expert_success": float(success.mean())}


def main() -> None:
    """Measures, prints the table and writes the JSON."""
    options = tyro.cli(Options, description=__doc__)
    configure()
    table = Table("setting", "control steps/s", "expert succeeds")
    results = {}
    for name, physics in VARIANTS.items():
        results[name] = {**asdict(physics), **measure(physics, options.episodes)}
        table.add_row(name, f"{results[name]['steps_per_s']:,.0f}", f"{results[name]['expert_success']:.1%}")
    Console().print(table)
    write_json(options.out, {"results": results, "episodes": options.episodes, **measured_on("physics_settings")})


if __name__ == "__main__":
    main()
