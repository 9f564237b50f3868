"""Small valid sources of every format of `graphrl import`, from which mutated ones are made. Task: Match Regions."""

import gzip
import json
import pickle
import sys
from collections import OrderedDict, namedtuple
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType

import imageio.v3 as imageio
import jax
import numpy as np

from graphrl_jax.registry import make_task
from graphrl_jax.viz.video import write_video

FRAMES, SIZE, FRAME_RATE = 5, 48, 8.0


def images() -> np.ndarray:
    """The images of a demonstration's first frames: (T, H, W, 3) uint8."""
    shown = make_task("match_regions").demonstrate(jax.random.key(0), 1, image_size=SIZE).images(SIZE)
    return np.asarray(shown[0, :FRAMES])


def write_video_file(folder: Path, shown: np.ndarray) -> None:
    write_video(shown, folder / "demo.mp4", FRAME_RATE)


def write_gif(folder: Path, shown: np.ndarray) -> None:
    imageio.imwrite(folder / "demo.gif", shown, duration=125)


def write_frames(folder: Path, shown: np.ndarray) -> None:
    for number, frame in enumerate(shown):
        imageio.imwrite(folder / f"frame_{number:03d}.png", frame)


def write_coco(folder: Path, shown: np.ndarray) -> None:
    """Boxes, polygons and scores; two objects per image."""
    listed, annotations = [], []
    for number in range(len(shown)):
        listed.append({"id": number, "file_name": f"frame_{number:03d}.png", "width": SIZE, "height": SIZE})
        box = {"bbox": [2 + number, 3, 8, 8], "category_id": 1, "score": 0.9}
        polygon = {"segmentation": [[20, 20, 30, 20, 30, 30, 20, 30]], "category_id": 2, "iscrowd": 0}
        annotations += [{"image_id": number, "id": 2 * number + n, **one} for n, one in enumerate((box, polygon))]
    names = make_task("match_regions").objects.class_names
    categories = [{"id": number + 1, "name": name} for number, name in enumerate(names)]
    content = {"images": listed, "annotations": annotations, "categories": categories}
    (folder / "annotations.json").write_text(json.dumps(content, indent=1))


def write_yolo(folder: Path, shown: np.ndarray) -> None:
    names = make_task("match_regions").objects.class_names
    (folder / "data.yaml").write_text("names: [" + ", ".join(names) + "]\n")
    for number in range(len(shown)):
        lines = f"0 {0.2 + 0.05 * number:.3f} 0.3 0.1 0.1 0.9\n1 0.5 0.5 0.6 0.5 0.6 0.6 0.5 0.6\n"
        (folder / f"frame_{number:03d}.txt").write_text(lines)


def write_corners(folder: Path, shown: np.ndarray) -> None:
    count = make_task("match_regions").objects.num_slots
    for number in range(len(shown)):
        lines = [f"{2 + number} {3 + slot} {8 + number} {9 + slot}" for slot in range(count)]
        (folder / f"{number}.txt").write_text("\n".join(lines) + "\n")


@contextmanager
def _class_of_magical() -> Iterator[Callable]:
    """MAGICAL's class, in a module that is gone when the file is read."""
    parents, name = ("milbench", "milbench.baselines"), "milbench.baselines.saved_trajectories"
    kind = namedtuple("MILBenchTrajectory", ("acts", "obs", "rews", "infos"))  # noqa: PYI024 - as MAGICAL writes it
    kind.__module__ = name
    module = ModuleType(name)
    module.MILBenchTrajectory = kind  # type: ignore[attr-defined]
    modules = {**{parent: ModuleType(parent) for parent in parents}, name: module}
    sys.modules.update(modules)
    try:
        yield kind
    finally:
        for one in modules:
            del sys.modules[one]


def write_magical(folder: Path, shown: np.ndarray) -> None:
    with _class_of_magical() as kind:
        observations = [OrderedDict(allo=frame, ego=frame[:8, :8]) for frame in shown]
        trajectory = kind(np.zeros(len(shown), np.int64), observations, [0.0], [{"eval_score": 0}])
        content = {"trajectory": trajectory, "score": 1.0, "env_name": "MatchRegions-Demo-v0"}
        (folder / "demo.pkl.gz").write_bytes(gzip.compress(pickle.dumps(content)))


WRITERS: dict[str, Callable[[Path, np.ndarray], None]] = {
    "video": write_video_file,
    "gif": write_gif,
    "frames": write_frames,
    "coco": write_coco,
    "yolo": write_yolo,
    "corners": write_corners,
    "magical": write_magical,
}
"""By name of the source: writes it into an empty folder."""
OPTIONS = {"corners": ["--format", "corners", "--size", str(SIZE), str(SIZE)]}
"""Options of `graphrl import` that a source needs."""
