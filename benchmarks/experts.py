"""How many unseen episodes of every task its scripted expert solves, acting like a policy, without a second try.

    python -m benchmarks.experts [--tasks match_regions_layout] [--episodes 256]

The episodes are those of an evaluation. Writes benchmarks/results/experts.json.
"""

from dataclasses import dataclass

import tyro

from benchmarks.checks import refuse_below, refuse_unknown
from benchmarks.context import RESULTS, measured_on
from graphrl_jax.experiment.untrained import evaluate_untrained, untrained
from graphrl_jax.registry import make_task, task_names
from graphrl_jax.runtime import configure
from graphrl_jax.storage import write_json


@dataclass(frozen=True)
class Options:
    """Evaluates experts.

    Attributes:
      tasks: registered tasks.
      episodes: unseen episodes of each.
      seed: decides the episodes.
    """

    tasks: tuple[str, ...] = tuple(task_names())
    episodes: int = 256
    seed: int = 7

    def __post_init__(self) -> None:
        refuse_below(self, episodes=1)
        refuse_unknown("--tasks", self.tasks, task_names())


def main() -> None:
    """Evaluates, prints and writes."""
    options = tyro.cli(Options, description=__doc__)
    configure()
    where = measured_on("experts")
    found = {}
    for name in options.tasks:
        found[name] = evaluate_untrained(untrained(make_task(name), "expert"), options.episodes, options.seed)
        print(name, {measure: found[name][measure] for measure in ("success_rate", "mean_score")}, flush=True)
    write_json(RESULTS / "experts.json", {"tasks": found, **where})


if __name__ == "__main__":
    main()
