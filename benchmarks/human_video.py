"""The import of real human demonstrations, judged by the truth that is known of them.

    python -m benchmarks.human_video FOLDER

FOLDER holds MAGICAL's `.pkl.gz` demonstrations and `truth.npz`. Measures the detector (overlap of boxes, objects found,
identities), its speed with tracking, and whether boxes of our own task mean the same as boxes in MAGICAL's frames.
Writes benchmarks/results/human_video.json.
"""

import multiprocessing
import os
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax
import numpy as np
import tyro

from benchmarks.context import RESULTS, measured_on
from graphrl_jax.perception.importers.convert import track_recording
from graphrl_jax.perception.importers.magical import read_trajectories
from graphrl_jax.perception.importers.recording import files_of
from graphrl_jax.storage import write_json
from tasks.match_regions import magical
from tasks.match_regions.layouts import demo_world
from tasks.match_regions.objects import OBJECTS
from tasks.match_regions.state import boxes

# Order of the objects in truth.npz, as node slots: star, square, three distractors, region, robot.
TRUTH_SLOTS = (2, 3, 4, 5, 6, 0, 1)
_NAMES = [OBJECTS.names[slot] for slot in TRUTH_SLOTS]


@dataclass(frozen=True)
class Options:
    """Measures detection and tracking on recorded demonstrations.

    Attributes:
      folder: of `.pkl.gz` files and `truth.npz`.
    """

    folder: tyro.conf.Positional[Path]


def look(path: Path) -> tuple[np.ndarray, np.ndarray, float]:
    """Boxes (T, N, 4), mask (T, N) and the seconds that seeing and tracking took, reading left out."""
    (recording,) = read_trajectories([path])
    started = time.perf_counter()
    boxes, mask, _ = track_recording(recording, OBJECTS, magical.detector())
    return boxes, mask, time.perf_counter() - started


def corners(boxes: np.ndarray) -> np.ndarray:
    """Boxes (..., 4) cx, cy, w, h as x0, y0, x1, y1."""
    return np.concatenate([boxes[..., :2] - boxes[..., 2:] / 2, boxes[..., :2] + boxes[..., 2:] / 2], axis=-1)


def overlap(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Intersection over union of boxes (..., 4), x0, y0, x1, y1, broadcast."""
    sides = np.minimum(one[..., 2:], other[..., 2:]) - np.maximum(one[..., :2], other[..., :2])
    common = np.clip(sides, 0, None).prod(-1)
    union = (one[..., 2:] - one[..., :2]).prod(-1) + (other[..., 2:] - other[..., :2]).prod(-1) - common
    return common / np.maximum(union, 1e-9)


def own_boxes(states: np.ndarray, finger_angles: np.ndarray) -> np.ndarray:
    """Boxes (T, 7, 4) that our task would see of MAGICAL's states (T, 24), in the order of the truth."""

    def look(state: jax.Array, fingers: jax.Array) -> jax.Array:
        qpos = jax.numpy.concatenate([state[:3], fingers, state[9:]])
        return boxes(qpos, demo_world())[0][jax.numpy.array(TRUTH_SLOTS)]

    return np.asarray(jax.jit(jax.vmap(look))(states.astype(np.float32), finger_angles.astype(np.float32)))


def main() -> None:
    """Measures, prints and writes."""
    options = tyro.cli(Options, description=__doc__)
    where = measured_on("human_video")
    truth = np.load(options.folder / "truth.npz")
    files = files_of(options.folder, ".pkl.gz")
    alone = [look(path) for path in files]
    workers = os.cpu_count() or 1
    with ProcessPoolExecutor(workers, multiprocessing.get_context("spawn")) as pool:
        together = list(pool.map(look, files))
    seen, mask = (np.stack([row[part] for row in alone])[:, :, TRUTH_SLOTS] for part in (0, 1))
    true = truth["boxes"]
    between = overlap(corners(seen)[:, :, :, None], true[:, :, None, :])
    own = np.einsum("btii->bti", between)
    # Whose box is it? The region is not asked: blocks lie in it.
    asked = [index for index, name in enumerate(_NAMES) if name != "goal_region"]
    nearest = np.argmax(between[:, :, asked][..., asked], axis=-1)
    ours = np.stack([own_boxes(*pair) for pair in zip(truth["states"], truth["rel_finger_angles"], strict=True)])
    alike = overlap(corners(ours), true)
    frames = seen.shape[0] * seen.shape[1]
    report: dict[str, Any] = {
        "demonstrations": len(files),
        "frames": frames,
        "iou": dict(zip(_NAMES, own.mean((0, 1)).tolist(), strict=True)),
        "least_iou": dict(zip(_NAMES, own.min((0, 1)).tolist(), strict=True)),
        "found": float(mask.mean()),
        "identity_switches": int((nearest != np.arange(len(asked))).sum()),
        "frames_per_second": {
            "one_core": frames / sum(seconds for _, _, seconds in alone),
            "all_cores": frames * workers / sum(seconds for _, _, seconds in together),
        },
        "iou_of_our_tasks_boxes": dict(zip(_NAMES, alike.mean((0, 1)).tolist(), strict=True)),
        **where,
    }
    write_json(RESULTS / "human_video.json", report)
    print({name: report[name] for name in ("iou", "found", "identity_switches", "frames_per_second")})
    print(report["iou_of_our_tasks_boxes"])


if __name__ == "__main__":
    main()
