"""A reward model pays the same on every device: rewards of released models on the device in use, beside those on a CPU.

    graphrl demos --task shoes_in_box --out shoes.npz
    python -m benchmarks.devices --model checkpoints/shoes_in_box_graph --demos shoes.npz

An encoder multiplies matrices at full float32 precision everywhere, so that the rewards differ by rounding alone.
Writes benchmarks/results/devices_TASK.json.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax
import numpy as np
import tyro

from benchmarks.context import RESULTS, measured_on
from graphrl_jax.demonstrations import Demonstrations
from graphrl_jax.experiment.checkpoints import load_run
from graphrl_jax.experiment.experiment import load_demonstrations
from graphrl_jax.reward.model import RewardModel, demonstration_rewards
from graphrl_jax.runtime import configure
from graphrl_jax.storage import write_json


@dataclass(frozen=True)
class Options:
    """Compares rewards on the device in use with those on a CPU.

    Attributes:
      model: folder of a run with a learned reward.
      demos: demonstration file; its frames are rewarded.
      out: result file; benchmarks/results/devices_TASK.json if left out.
    """

    model: Path
    demos: Path
    out: Path | None = None


def rewards_on(platform: str, model: RewardModel, demonstrations: Demonstrations) -> np.ndarray:
    """Reward of every frame, computed on a device of that kind: (B, T) float32."""
    device = jax.devices(platform)[0]
    with jax.default_device(device):
        return np.asarray(demonstration_rewards(jax.device_put(model, device), demonstrations))


def differences(here: np.ndarray, there: np.ndarray, lengths: np.ndarray) -> dict[str, Any]:
    """The largest and the mean difference between rewards (B, T) of frames that were shown, and the rewards' range."""
    shown = np.arange(here.shape[1]) < lengths[:, None]
    difference = np.abs(here - there)[shown]
    return {
        "frames": int(shown.sum()),
        "largest_difference": float(difference.max()),
        "mean_difference": float(difference.mean()),
        "rewards": [float(here[shown].min()), float(here[shown].max())],
    }


def main() -> None:
    """Compares, prints and writes."""
    options = tyro.cli(Options, description=__doc__)
    configure()
    where = measured_on("devices")
    trained = load_run(options.model)
    task = trained.task
    if not isinstance(trained.reward_params, RewardModel):
        raise SystemExit(f"--model {options.model} learned no reward; allowed: a run with a learned reward")
    demonstrations = load_demonstrations(options.demos, task.objects, task.frame_rate, task.name)
    platforms = jax.default_backend(), "cpu"
    here, there = (rewards_on(platform, trained.reward_params, demonstrations) for platform in platforms)
    found = differences(here, there, demonstrations.lengths)
    write_json(options.out or RESULTS / f"devices_{task.name}.json", found | where)
    print(found)


if __name__ == "__main__":
    main()
