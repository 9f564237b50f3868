"""Small valid sources of every format of `graphrl import`, from which mutated ones are made. Task: Match Regions."""

import gzip
import io
import json
import pickle
import sys
from collections import OrderedDict, namedtuple
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType

import h5py
import imageio.v3 as imageio
import jax
import numpy as np
import pyarrow as pa
from PIL import Image
from pyarrow import parquet

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


def write_cvat(folder: Path, shown: np.ndarray) -> None:
    """Two tracks through a video."""
    names, tracks = make_task("match_regions").objects.class_names[:2], ""
    for number, name in enumerate(names):
        boxes = "".join(
            f'<box frame="{frame}" keyframe="{int(frame % 2 == 0)}" outside="0" occluded="0" xtl="{2 + frame}.00"'
            f' ytl="{5 + 10 * number}.00" xbr="{12 + frame}.00" ybr="{15 + 10 * number}.00" z_order="0"></box>\n'
            for frame in range(len(shown))
        )
        tracks += f'<track id="{number}" label="{name}" source="manual">\n{boxes}</track>\n'
    size = f"<original_size><width>{SIZE}</width><height>{SIZE}</height></original_size>"
    task = (
        f"<task><id>1</id><size>{len(shown)}</size><mode>interpolation</mode><start_frame>0</start_frame>{size}</task>"
    )
    text = f'<?xml version="1.0" encoding="utf-8"?>\n<annotations>\n<version>1.1</version>\n<meta>{task}</meta>\n'
    (folder / "annotations.xml").write_text(f"{text}{tracks}</annotations>\n")


def write_mot(folder: Path, shown: np.ndarray) -> None:
    told = f"[Sequence]\nname=pick\nframeRate=8\nseqLength={len(shown)}\nimWidth={SIZE}\nimHeight={SIZE}\n"
    (folder / "seqinfo.ini").write_text(told)
    (folder / "gt").mkdir()
    lines = [
        f"{frame + 1},{n + 1},{3 + frame},{4 + 9 * n},8,8,1,{n + 1},1" for n in (0, 1) for frame in range(len(shown))
    ]
    (folder / "gt" / "gt.txt").write_text("\n".join(lines) + "\n")


def write_label_studio(folder: Path, shown: np.ndarray) -> None:
    """A track through a video, and a box on an image."""
    name = make_task("match_regions").objects.class_names[0]
    place = {"y": 20, "width": 20, "height": 30, "rotation": 0}
    keys = [{"frame": n + 1, "time": n / 8, "enabled": True, "x": 10 + n, **place} for n in range(0, len(shown), 2)]
    track = {"framesCount": len(shown), "duration": len(shown) / 8, "sequence": keys, "labels": [name]}
    result = {"id": "a", "type": "videorectangle", "from_name": "box", "to_name": "video", "value": track}
    annotation = {"id": 1, "was_cancelled": False, "ground_truth": False, "result": [result]}
    task = {"id": 1, "data": {"video": "/data/upload/1/pick.mp4"}, "annotations": [annotation]}
    (folder / "export.json").write_text(json.dumps([task], indent=1))


def write_masks(folder: Path, shown: np.ndarray) -> None:
    (folder / "masks").mkdir()
    for number in range(len(shown)):
        values = np.zeros((SIZE, SIZE), np.uint8)
        values[5:15, 2 + number : 12 + number] = 1
        values[20:30, 5:15] = 2
        image = Image.fromarray(values)
        image.putpalette([(7 * value + 3) % 256 for value in range(768)])
        image.save(folder / "masks" / f"{number:05d}.png")


def write_lerobot(folder: Path, shown: np.ndarray) -> None:
    """Two episodes of a LeRobotDataset v3.0, with the pictures in the data file."""
    count, camera, dataset = len(shown), "observation.images.top", folder / "dataset"

    def cell(frame: np.ndarray) -> dict[str, object]:
        file = io.BytesIO()
        Image.fromarray(frame).save(file, "PNG")
        return {"bytes": file.getvalue(), "path": "frame.png"}

    def table(name: str, rows: list[dict[str, object]]) -> None:
        path = dataset / name
        path.parent.mkdir(parents=True, exist_ok=True)
        parquet.write_table(pa.Table.from_pylist(rows), path)

    frames = [(episode, frame) for episode in range(2) for frame in range(count)]
    rows = [
        {"timestamp": frame / 8, "frame_index": frame, "episode_index": episode, "index": episode * count + frame}
        | {"task_index": 0, camera: cell(shown[frame])}
        for episode, frame in frames
    ]
    table("data/chunk-000/file-000.parquet", rows)
    spans = [{"dataset_from_index": n * count, "dataset_to_index": (n + 1) * count} for n in range(2)]
    placed = {"data/chunk_index": 0, "data/file_index": 0, "tasks": ["pick"], "length": count}
    table("meta/episodes/chunk-000/file-000.parquet", [{"episode_index": n, **placed, **spans[n]} for n in range(2)])
    feature = {"dtype": "image", "shape": [SIZE, SIZE, 3], "names": ["height", "width", "channels"]}
    info = {"codebase_version": "v3.0", "fps": 8, "features": {camera: feature}, "chunks_size": 1000}
    info |= {"total_episodes": 2, "total_frames": 2 * count, "video_path": None}
    info["data_path"] = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
    (dataset / "meta" / "info.json").write_text(json.dumps(info, indent=1))


def write_robomimic(folder: Path, shown: np.ndarray) -> None:
    with h5py.File(folder / "demo.hdf5", "w") as file:
        for number in range(2):
            demo = file.create_group(f"data/demo_{number}")
            demo.attrs["num_samples"] = len(shown)
            demo.create_dataset("obs/agentview_image", data=shown, compression="gzip")


WRITERS: dict[str, Callable[[Path, np.ndarray], None]] = {
    "video": write_video_file,
    "gif": write_gif,
    "frames": write_frames,
    "coco": write_coco,
    "yolo": write_yolo,
    "corners": write_corners,
    "magical": write_magical,
    "cvat": write_cvat,
    "mot": write_mot,
    "label_studio": write_label_studio,
    "masks": write_masks,
    "lerobot": write_lerobot,
    "robomimic": write_robomimic,
}
"""By name of the source: writes it into an empty folder."""
OPTIONS = {"corners": ["--format", "corners", "--size", str(SIZE), str(SIZE)]}
"""Options of `graphrl import` that a source needs."""
