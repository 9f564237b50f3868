"""A trained detector in the place of colours, the whole way: its training, its boxes, and the rewards they lead to.

    pip install -e ".[detect]" && python -m benchmarks.detector [--work runs/detector]

Draws the desk of docs/your_own_video.md with the true box of every object, trains a nano YOLO on such images from
scratch, and judges it on unseen ones through `perception.model_detector`. Then `import --weights`, `pretrain` and
`score --weights` run on videos; the rewards are compared with those of the true boxes. Everything runs on one core and
nothing may use the network: what is tried is refused and counted. A training that was interrupted goes on, and one that
is finished is not repeated. Writes benchmarks/results/detector.json.
"""

import contextlib
import importlib
import io
import json
import os
import shutil
import socket
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tyro
import yaml
from matplotlib import get_data_path
from PIL import Image
from pyarrow import parquet
from scipy.stats import spearmanr

from benchmarks.checks import refuse_below
from benchmarks.context import RESULTS, measured_on
from benchmarks.human_video import corners, overlap
from docs.examples.desk import make_videos as desk
from graphrl_jax.cli import main as main_of_commands
from graphrl_jax.demonstrations import Demonstrations, load
from graphrl_jax.perception.detector import Detector
from graphrl_jax.perception.importers.recording import resampled_frames
from graphrl_jax.perception.model_detector import ultralytics
from graphrl_jax.perception.objects_file import ObjectsFile, read_objects
from graphrl_jax.storage import read_json, write_json
from graphrl_jax.viz.video import write_video

DESK = Path("docs/examples/desk/desk.toml")
NEW_VIDEOS = {"both": 4, "cup": 2, "nothing": 2}
"""Videos to score, by what is done in them."""
TRAIN, UNSEEN, DEMONSTRATIONS, NEW = range(4)
"""Sources of randomness, so that no scene occurs in two places."""
RING = (desk.SIZES["hand"][0] / 2, desk.SIZES["hand"][0] / 2 * np.cos(np.radians(desk.OPENING)))
"""Of the hand's ring in pixels: its radius, and its right side, which is open."""


@dataclass(frozen=True)
class Options:
    """A detector, trained and used.

    Attributes:
      work: folder of images, weights, videos and scores.
      architecture: configuration of the model in the package; its weights start at random.
      images: images to train on.
      unseen: images to judge on.
      epochs: passes over the images.
      image_size: longer side of the images that the model sees, in pixels.
      demonstrations: videos that the reward model learns from.
      seed: of images, weights, videos and pretraining.
    """

    work: Path = Path("runs/detector")
    architecture: str = "yolov8n.yaml"
    images: int = 1200
    unseen: int = 100
    epochs: int = 12
    image_size: int = 256
    demonstrations: int = 10
    seed: int = 0

    def __post_init__(self) -> None:
        refuse_below(self, images=1, unseen=1, epochs=1, image_size=32, demonstrations=4, seed=0)


def true_boxes(places: dict[str, np.ndarray], names: Sequence[str]) -> np.ndarray:
    """Boxes (N, 4) float32, cx, cy, w, h as shares of the image's sides, of the pixels that each object is drawn on.

    Args:
      places: centre of every object in pixels.
      names: of the objects, in the order of the boxes. A box also counts what other objects hide.
    """
    rows = []
    for name in names:
        half = np.array(desk.SIZES[name]) / 2
        low, high = (half, half) if name != "hand" else (np.full(2, RING[0]), np.array(RING[::-1]))
        pixel = np.floor if name in ("hand", "cup") else np.round  # as Pillow draws arcs, ellipses and rectangles
        first, last = pixel(places[name] - low), pixel(places[name] + high)  # both of them drawn
        rows.append([*(first + last + 1) / 2, *(last + 1 - first)])
    return (np.array(rows) / [desk.WIDTH, desk.HEIGHT, desk.WIDTH, desk.HEIGHT]).astype(np.float32)


def label_text(boxes: np.ndarray) -> str:
    """YOLO's lines `class cx cy w h` of boxes (N, 4), the class of a box being its number."""
    return "".join(f"{number} " + " ".join(f"{value:.6f}" for value in box) + "\n" for number, box in enumerate(boxes))


def drawn_images(count: int, names: Sequence[str], seed: Sequence[int]) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Images and their true boxes (N, 4), four at random of each of as many videos as it takes."""
    for number in range(count):
        draw = np.random.default_rng([*seed, number // 4])
        motion = list(desk.motion(draw, list(desk.JOBS.values())[number // 4 % len(desk.JOBS)]))
        places = motion[draw.permutation(len(motion))[number % 4]]
        yield desk.image(places, np.random.default_rng([*seed, number // 4, number])), true_boxes(places, names)


def write_dataset(folder: Path, names: Sequence[str], counts: dict[str, int], seed: int) -> Path:
    """Writes a dataset for YOLO: `data.yaml`, `images/SPLIT/*.jpg` and `labels/SPLIT/*.txt`; returns `data.yaml`.

    Args:
      folder: to write to; what is there is replaced.
      names: of the objects, which are the classes.
      counts: number of images of every split: `train`, `val`.
      seed: of the images.
    """
    shutil.rmtree(folder, ignore_errors=True)
    for source, (split, count) in zip((TRAIN, UNSEEN), counts.items(), strict=True):
        images, labels = folder / "images" / split, folder / "labels" / split
        images.mkdir(parents=True)
        labels.mkdir(parents=True)
        for number, (image, boxes) in enumerate(drawn_images(count, names, (seed, source))):
            Image.fromarray(image).save(images / f"{number:05d}.jpg", quality=92)
            (labels / f"{number:05d}.txt").write_text(label_text(boxes))
    content = {"path": str(folder.absolute()), **{split: f"images/{split}" for split in counts}}
    (folder / "data.yaml").write_text(yaml.safe_dump({**content, "names": dict(enumerate(names))}))
    return folder / "data.yaml"


def keep_offline(work: Path) -> list[str]:
    """Refuses whatever this process tries on the network from now on; returns the list that it is written to.

    Ultralytics looks for a font, a newer version, and a place to send statistics to.
    """
    settings = work / "settings" / "Ultralytics"
    settings.mkdir(parents=True, exist_ok=True)
    shutil.copy(Path(get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf", settings / "Arial.ttf")
    os.environ |= {
        "YOLO_CONFIG_DIR": str(settings.parent.absolute()),
        "YOLO_OFFLINE": "true",
        "YOLO_AUTOINSTALL": "false",
    }
    tried: list[str] = []

    def watch(event: str, arguments: tuple[Any, ...]) -> None:
        outward = event == "socket.connect" and arguments[0].family != socket.AF_UNIX
        if outward or event in ("socket.getaddrinfo", "socket.gethostbyname"):
            tried.append(f"{event} {arguments[1:] if outward else arguments}")
            raise OSError("this benchmark does not use the network")

    sys.addaudithook(watch)
    return tried


def train(options: Options, data: Path) -> dict[str, Any]:
    """Trains from scratch, goes on with a training that was interrupted, or reads what a finished one has told.

    Args:
      options: what to train.
      data: `data.yaml` of the dataset.

    Returns:
      The file of `weights`, relative to the working directory, and the seconds of the clock and of the core that the
      training took, or its last part if it was interrupted.
    """
    done, folder = options.work / "training.json", options.work / "yolo"
    if done.exists():
        return read_json(done)
    package = importlib.import_module("ultralytics")
    package.settings.update({"sync": False})
    last = folder / "weights" / "last.pt"
    started, cpu = time.perf_counter(), time.process_time()
    if last.exists():
        package.YOLO(last).train(resume=True)
    else:
        plain = dict.fromkeys(("mosaic", "hsv_h", "hsv_s", "hsv_v", "fliplr", "scale", "translate"), 0.0)
        package.YOLO(options.architecture).train(
            data=str(data), epochs=options.epochs, imgsz=options.image_size, batch=8, nbs=8, workers=0, device="cpu",
            amp=False, pretrained=False, optimizer="AdamW", lr0=0.002, cos_lr=True, warmup_epochs=0.5,
            seed=options.seed, val=False, plots=False, verbose=False, exist_ok=True,
            project=str(folder.parent.absolute()), name=folder.name, **plain,
        )  # fmt: skip
    seconds, cpu = time.perf_counter() - started, time.process_time() - cpu
    told = {"weights": str(last), "seconds": seconds, "cpu_seconds": cpu}
    write_json(done, told)
    return told


def refuse_another(options: Options) -> None:
    """Notes in the work folder what is trained there.

    Raises:
      ValueError: something else has been trained there.
    """
    path, names = options.work / "options.json", ("architecture", "images", "unseen", "epochs", "image_size", "seed")
    asked = {name: getattr(options, name) for name in names}
    if path.exists() and read_json(path) != asked:
        raise ValueError(f"--work {options.work} is of a detector with {read_json(path)}; choose another folder")
    write_json(path, asked)


def judged(
    detector: Detector, images: Sequence[np.ndarray], truth: np.ndarray, names: Sequence[str]
) -> dict[str, dict[str, float]]:
    """How well a detector with a class per object finds the objects of images: its most confident box of each counts.

    Args:
      detector: class ids are the objects' numbers.
      images: B images.
      truth: (B, N, 4) float32, true boxes.
      names: of the N objects.

    Returns:
      By object: the share of images in which it was `found`; `mean_iou` and `least_iou` with its true box where it was
      found; in how many images the box fits another object better than its own (`identity_errors`).
    """
    boxes = np.full(truth.shape, np.nan, np.float32)
    for index, image in enumerate(images):
        for found in sorted(detector.detect(image), key=lambda found: found.confidence):
            boxes[index, found.class_id] = found.box
    between = overlap(corners(boxes)[:, :, None], corners(truth)[:, None])
    seen = ~np.isnan(boxes[..., 0])
    nearest = np.argmax(between, axis=-1)
    return {
        name: {
            **fit(seen[:, number], between[:, number, number]),
            "identity_errors": int(np.sum(seen[:, number] & (nearest[:, number] != number))),
        }
        for number, name in enumerate(names)
    }


def fit(seen: np.ndarray, ious: np.ndarray) -> dict[str, float]:
    """The share of frames in which an object was seen (B,) bool, and the overlap (B,) with its true box in these."""
    own = ious[seen] if seen.any() else np.zeros(1)
    return {"found": float(seen.mean()), "mean_iou": float(own.mean()), "least_iou": float(own.min())}


def held_by_hand(boxes: np.ndarray, names: Sequence[str], name: str) -> np.ndarray:
    """Where an object's centre is at most a quarter of the hand's sides from the hand's: (B, N, 4) -> (B,) bool."""
    hand, other = (boxes[:, names.index(one)] for one in ("hand", name))
    return (np.abs(other[:, :2] - hand[:, :2]) < hand[:, 2:] / 4).all(-1)


def unseen(data: Path) -> tuple[list[np.ndarray], np.ndarray]:
    """Images and true boxes (B, N, 4) of a dataset's split `val`, as the files have them."""
    paths = sorted((data.parent / "images" / "val").glob("*.jpg"))
    labels = [np.loadtxt(data.parent / "labels" / "val" / f"{path.stem}.txt", np.float32, ndmin=2) for path in paths]
    return [np.asarray(Image.open(path)) for path in paths], np.stack(labels)[..., 1:]


def film(folder: Path, job: str, source: Sequence[int], about: ObjectsFile) -> tuple[np.ndarray, float]:
    """Writes one video, and labels of what `graphrl` will see of it: true boxes, at the objects' frame rate.

    Args:
      folder: gets `videos/NAME.mp4` and `labels/NAME/*.txt`.
      source: of all randomness; ends in the number of the name.

    Returns:
      The true boxes (T, N, 4), and the video's seconds.
    """
    draw, name = np.random.default_rng(source), f"{job}_{source[-1]:02d}"
    motion = list(desk.motion(draw, desk.JOBS[job]))
    images = np.stack([desk.image(places, draw) for places in motion])
    write_video(images, folder / "videos" / f"{name}.mp4", desk.FRAME_RATE)
    shown = resampled_frames(len(motion), desk.FRAME_RATE, about.frame_rate)
    assert shown is not None  # the rates differ
    boxes = np.stack([true_boxes(motion[index], about.objects.names) for index in shown])
    labels = folder / "labels" / name
    labels.mkdir(parents=True)
    for number, row in enumerate(boxes):
        (labels / f"{number:04d}.txt").write_text(label_text(row))
    return boxes, len(motion) / desk.FRAME_RATE


def graphrl(*arguments: str | Path) -> dict[str, Any]:
    """Runs a command in this process; returns its answer."""
    with contextlib.redirect_stdout(io.StringIO()) as answer:
        main_of_commands([str(one) for one in arguments])
    return json.loads(answer.getvalue())


def import_and_score(options: Options, weights: Path, about: ObjectsFile) -> dict[str, Any]:
    """Videos -> boxes -> reward model -> scores, and the same scores of true boxes."""
    folder = options.work / "recordings"
    shutil.rmtree(folder, ignore_errors=True)
    old, new, found = folder / "old", folder / "new", ("--weights", weights)
    truth = [film(old, "both", (options.seed, DEMONSTRATIONS, n), about)[0] for n in range(options.demonstrations)]
    films = [(job, (options.seed, NEW, n)) for job, count in NEW_VIDEOS.items() for n in range(count)]
    played = sum(film(new, job, source, about)[1] for job, source in films)
    demos = folder / "demos.npz"
    graphrl("import", old / "videos", "--objects", DESK, *found, "--out", demos)
    graphrl("pretrain", "--demos", demos, "--out", folder / "model", "--steps", "1000", "--seed", str(options.seed))
    started = time.perf_counter()
    graphrl("score", folder / "model", new / "videos", *found, "--out", folder / "scores")
    seconds = time.perf_counter() - started
    graphrl("score", folder / "model", new / "labels", "--format", "yolo", "--out", folder / "true_scores")
    return {
        "boxes_in_demonstrations": tracked(load(demos), truth),
        "scored_seconds": played,
        "seconds_to_score": seconds,
        **compared(folder / "scores", folder / "true_scores"),
    }


def tracked(demos: Demonstrations, truth: Sequence[np.ndarray]) -> dict[str, dict[str, float]]:
    """How well the boxes of demonstrations fit the true ones (T_b, N, 4), by object."""
    each = zip(demos.boxes, demos.mask, truth, strict=True)
    rows = [(boxes[: len(true)], mask[: len(true)], true) for boxes, mask, true in each]
    boxes, mask, true = (np.concatenate(parts) for parts in zip(*rows, strict=True))
    ious = overlap(corners(boxes), corners(true))
    return {name: fit(mask[:, slot], ious[:, slot]) for slot, name in enumerate(demos.objects.names)}


def compared(scores: Path, true_scores: Path) -> dict[str, Any]:
    """Rewards of detected boxes beside those of true boxes."""
    ours, true = _scored(scores), _scored(true_scores)
    lengths = {name: min(len(one[name]["reward"]) for one in (ours, true)) for name in true}  # a video may lack a frame
    rewards = {name: [one[name]["reward"][:length] for one in (ours, true)] for name, length in lengths.items()}
    apart = np.concatenate([np.abs(mine - theirs) for mine, theirs in rewards.values()])
    order = {name: float(spearmanr(*both).statistic) for name, both in rewards.items()}
    ends = [[one[name]["final_progress"] for name in true] for one in (ours, true)]

    def told(row: dict[str, Any]) -> dict[str, Any]:
        return {name: row[name] for name in ("final_progress", "looks_like_success")}

    return {
        "reward_difference": {"mean": float(apart.mean()), "most": float(apart.max())},
        "rank_correlation": {
            "of_frames": {"mean": float(np.mean(list(order.values()))), "least": min(order.values())},
            "of_recordings": float(spearmanr(*ends).statistic),
        },
        "recordings": {
            name: {"detected": told(ours[name]), "true": told(true[name]), "rank_correlation": order[name]}
            for name in sorted(true)
        },
    }


def _scored(folder: Path) -> dict[str, dict[str, Any]]:
    """The rows of `scores.json` by name of the recording, with the `reward` of every frame of the model's rate.

    The table has a row for every frame of the recording itself, and videos have more of them than labels.
    """
    table = parquet.read_table(folder / "progress.parquet", columns=["episode_index", "reward"])
    episodes, rewards = (table[name].to_numpy() for name in table.column_names)
    rows = read_json(folder / "scores.json")["recordings"]

    def at_models_rate(row: dict[str, Any]) -> np.ndarray:
        own = rewards[episodes == row["episode_index"]]
        return own[:: round(len(own) / row["frames"])]

    return {Path(row["recording"]).stem: {**row, "reward": at_models_rate(row)} for row in rows}


def speed(detector: Detector, images: Sequence[np.ndarray]) -> dict[str, float]:
    """Frames that a detector sees in a second, by the clock and of the core's time."""
    detector.detect(images[0])
    started, cpu = time.perf_counter(), time.process_time()
    for image in images:
        detector.detect(image)
    seconds, cpu = time.perf_counter() - started, time.process_time() - cpu
    return {"by_the_clock": len(images) / seconds, "of_the_cores_time": len(images) / cpu}


def main() -> None:
    """Trains, judges, prints and writes."""
    options = tyro.cli(Options, description=__doc__)
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    refuse_another(options)
    tried = keep_offline(options.work)
    where = measured_on("detector")
    about = read_objects(DESK)
    names, counts = about.objects.names, {"train": options.images, "val": options.unseen}
    data = options.work / "data" / "data.yaml"
    if not data.exists():
        write_dataset(data.parent, names, counts, options.seed)
    training = train(options, data)
    weights = Path(training["weights"])
    detector, (images, truth) = ultralytics(weights, about.objects), unseen(data)
    package = importlib.import_module("ultralytics")
    # Of objects with one centre, a model that predicts one box per place may find only one.
    held = np.flatnonzero(held_by_hand(truth, names, "cup"))
    report = {
        "training": {**read_json(options.work / "options.json"), **training},
        "unseen_images": judged(detector, images, truth, names),
        "cup_in_hand": judged(detector, [images[index] for index in held], truth[held], names)["cup"],
        "red_and_blue_exchanged": judged(detector, [image[..., ::-1] for image in images], truth, names),
        "frames_per_second": speed(detector, images),
        "video_frames_per_second": desk.FRAME_RATE,
        **import_and_score(options, weights, about),
        "tried_on_the_network": tried,
        "ultralytics": package.__version__,
        "torch": importlib.import_module("torch").__version__,
        **where,
    }
    write_json(RESULTS / "detector.json", report)
    print({name: report[name] for name in ("unseen_images", "frames_per_second", "reward_difference")})


if __name__ == "__main__":
    main()
