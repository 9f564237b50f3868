"""How well `graphrl score` tells recordings apart, and how long the way from videos to its page is. One command:

    python -m benchmarks.scores [--parts desk human] [--human FOLDER]

    desk    ten drawn videos of ten seconds -> demonstrations -> reward model -> scores of other videos, by the commands
            of docs/your_own_video.md, each in a process of its own: seconds, and the ranking
    human   MAGICAL's human demonstrations in FOLDER, a few held out at a time and scored by a model of the others:
            value order, and which of them look like success, whole and cut off at half

Writes `benchmarks/results/scores.json`; a part that is not asked for keeps what the file has.
"""

import os
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import tyro

from benchmarks.checks import refuse_below, refuse_unknown
from benchmarks.context import RESULTS, measured_on
from graphrl_jax.cli import import_recordings, pretrain
from graphrl_jax.cli.requests import Import, Pretrain
from graphrl_jax.demonstrations import Demonstrations, load
from graphrl_jax.experiment.recorded import RecordedTask
from graphrl_jax.reward.model import RewardModel
from graphrl_jax.reward.scoring import score, summary
from graphrl_jax.storage import read_json, write_json

DESK = Path("docs/examples/desk")
NEW_VIDEOS = {"both": 6, "cup": 3, "nothing": 3}
"""Videos to score: both jobs done, one of them, none."""
MEASURES = (
    "final_progress", "value_order_correlation", "value_order_before_rest", "rest", "looks_like_success",
)  # fmt: skip
PARTS = ("desk", "human")


@dataclass(frozen=True)
class Options:
    """Scores of recordings, drawn and human.

    Attributes:
      parts: what to measure.
      human: folder of MAGICAL's `.pkl.gz` files of Match Regions; needed for the part human.
      folds: parts into which the human demonstrations are split, each held out once.
      seed: of the videos that are scored, and of pretraining.
    """

    parts: tuple[str, ...] = ("desk",)
    human: Path | None = None
    folds: int = 5
    seed: int = 1

    def __post_init__(self) -> None:
        refuse_unknown("--parts", self.parts, PARTS)
        refuse_below(self, folds=2, seed=1)
        if "human" in self.parts and self.human is None:
            raise ValueError("--human is missing; allowed: a folder of .pkl.gz files")


def desk(options: Options, folder: Path) -> dict[str, Any]:
    """From drawn videos to a page of scores."""
    _draw(folder / "my_videos", "both", 10, 0)
    for job, number in NEW_VIDEOS.items():
        _draw(folder / "new_videos", job, number, options.seed)
    objects = ["--objects", str((DESK / "desk.toml").absolute())]
    commands = {
        "import": ["import", "my_videos", *objects, "--out", "demos.npz"],
        "pretrain": ["pretrain", "--demos", "demos.npz", "--out", "desk", "--seed", str(options.seed)],
        "score": ["score", "desk", "new_videos", *objects, "--out", "scores"],
    }
    seconds = {name: _timed(arguments, folder) for name, arguments in commands.items()}
    scored = read_json(folder / "scores" / "scores.json")["recordings"]
    played = sum(row["seconds"] for row in scored)
    return {
        "seconds": seconds,
        "scored_seconds": played,
        "seed": options.seed,
        "recordings": [{"recording": Path(row["recording"]).stem, **_measures(row)} for row in scored],
    }


def _draw(folder: Path, job: str, number: int, seed: int) -> None:
    drawn = [sys.executable, str(DESK / "make_videos.py"), str(folder), "--job", job]
    subprocess.run([*drawn, "--num", str(number), "--seed", str(seed)], check=True)


def _timed(arguments: list[str], folder: Path) -> float:
    """Seconds of a command, in a process of its own that works in `folder`."""
    started = time.perf_counter()
    here = {**os.environ, "PYTHONPATH": str(Path.cwd())}
    command = [sys.executable, "-m", "graphrl_jax", *arguments]
    subprocess.run(command, cwd=folder, env=here, check=True, stdout=subprocess.DEVNULL)
    return round(time.perf_counter() - started, 1)


def human(options: Options, folder: Path) -> dict[str, Any]:
    """Each human demonstration, scored by a model of those of the other folds."""
    assert options.human is not None
    import_recordings.run(Import(options.human, folder / "demos.npz"))
    demos = load(folder / "demos.npz")
    order = np.random.default_rng(options.seed).permutation(len(demos))
    rows = []
    for fold in range(options.folds):
        held_out = np.sort(order[fold :: options.folds])
        model = _model(demos, np.setdiff1d(order, held_out), folder / str(fold), options.seed)
        rows += [{"demonstration": int(one), **_whole_and_half(model, demos, one)} for one in held_out]
    return {"folds": options.folds, "seed": options.seed, "demonstrations": rows}


def _model(demos: Demonstrations, chosen: np.ndarray, folder: Path, seed: int) -> RewardModel:
    """A reward model of the chosen demonstrations, trained as for a task that is known from recordings alone."""
    wanted = Pretrain(folder.with_suffix(".npz"), folder / "run", seed=seed)
    demos.select(chosen).save(wanted.demos)
    pretrain.run(replace(wanted, pretrain=replace(wanted.pretrain, **RecordedTask.pretrain_overrides)))
    return RewardModel.load(wanted.out)


def _whole_and_half(model: RewardModel, demos: Demonstrations, number: int) -> dict[str, Any]:
    length = int(demos.lengths[number])
    return {
        name: _measures(summary(model, score(model, demos.boxes[number, :end], demos.mask[number, :end])))
        for name, end in {"whole": length, "half": length // 2}.items()
    }


def _measures(row: dict[str, Any]) -> dict[str, Any]:
    return {name: row[name] for name in MEASURES}


def main() -> None:
    """Measures, prints and writes."""
    options = tyro.cli(Options, description=__doc__)
    path = RESULTS / "scores.json"
    report = read_json(path) if path.exists() else {}
    measure = {"desk": desk, "human": human}
    for part in options.parts:
        with tempfile.TemporaryDirectory() as folder:
            found = measure[part](options, Path(folder))
        report[part] = {**found, **measured_on("scores")}
        print(found)
        write_json(path, report)


if __name__ == "__main__":
    main()
