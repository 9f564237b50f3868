"""Policies on every one of MAGICAL's variants: how much of what was learned on one holds on the others.

    python -m benchmarks.variants runs/layout_env_0 runs/layout_graph_0

The runs' task has to be one of `match_regions_<variant>`: these share one environment, so that all variants are
evaluated by one compiled program. Writes benchmarks/results/match_regions_variants.json and an image of each variant.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import imageio.v3 as imageio
import jax
import jax.numpy as jnp
import numpy as np
import tyro

from benchmarks.context import RESULTS, measured_on
from graphrl_jax.experiment.checkpoints import load_run
from graphrl_jax.experiment.evaluation import evaluation_config
from graphrl_jax.rl.rollout import evaluate
from graphrl_jax.rl.wrappers import WRAPPERS, EnvironmentReward
from graphrl_jax.runtime import configure
from graphrl_jax.storage import read_json, write_atomically, write_json
from tasks.match_regions import variants
from tasks.match_regions.layouts import World
from tasks.match_regions.render import draw_scene
from tasks.match_regions.task import MatchRegions

EPISODES, SEED = 256, 7
_SHOWN = 5


@dataclass(frozen=True)
class Options:
    """Evaluates finished runs on every variant.

    Attributes:
      runs: folders of runs on variants.
    """

    runs: tyro.conf.Positional[tuple[Path, ...]]


def on_every_variant(path: Path, task: MatchRegions) -> dict[str, Any]:
    """Success and mean score of a run's policy on each variant, over the same unseen episodes as every other's."""
    trained = load_run(path)
    trained_on, settings, reward, policy = trained
    if trained_on.objects != task.objects:
        raise ValueError(f"{path} is of task {trained_on.name}; allowed: match_regions_<variant>")
    config = evaluation_config(trained)
    wrapper = WRAPPERS[settings.method.needs]

    def make_env(params: tuple[variants.Variant, Any]) -> EnvironmentReward:
        variant, reward = params
        return wrapper(task.with_layout(variant), reward)

    key = jax.random.fold_in(jax.random.key(SEED), 0)
    found = {
        name: evaluate(config, make_env, (variant, reward), policy, key, EPISODES)
        for name, variant in variants.VARIANTS.items()
    }
    summary = read_json(path / "summary.json")
    return {
        "run": path.name,
        "trained_on": trained_on.name,
        "reward": settings.reward,
        "training_seed": settings.seed,
        "env_steps": summary["env_steps"],
        "wall_s": summary.get("wall_s"),
        "success": {name: float(jnp.mean(outcomes["success"])) for name, outcomes in found.items()},
        "score": {name: float(jnp.mean(outcomes["score"])) for name, outcomes in found.items()},
    }


def starts_image(size: int = 200) -> np.ndarray:
    """A few starts of every variant, one row each: (rows * size, columns * size, 3) uint8."""
    rows = []
    for variant in variants.VARIANTS.values():
        starts = jax.vmap(variant.sample)(jax.random.split(jax.random.key(SEED), _SHOWN))
        qpos, worlds = jax.tree.map(np.asarray, (starts.qpos, starts.world))
        shown = [draw_scene(qpos[i], World(*(leaf[i] for leaf in worlds)), size) for i in range(_SHOWN)]
        rows.append(np.concatenate(shown, axis=1))
    return np.concatenate(rows)


def main() -> None:
    """Evaluates, prints and writes."""
    options = tyro.cli(Options, description=__doc__)
    configure()
    where = measured_on("variants")
    task = variants.make("demo")
    members = [on_every_variant(path, task) for path in options.runs]
    write_json(
        RESULTS / "match_regions_variants.json", {"policies": members, "episodes": EPISODES, "seed": SEED, **where}
    )
    shown = starts_image()
    write_atomically(RESULTS / "match_regions_variants.png", lambda temporary: imageio.imwrite(temporary, shown))
    for member in members:
        print(member["run"], {name: round(rate, 3) for name, rate in member["success"].items()})


if __name__ == "__main__":
    main()
