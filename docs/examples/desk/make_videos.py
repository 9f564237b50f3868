"""Draws videos of a hand that puts a cup and a book on a tray.

    python docs/examples/desk/make_videos.py FOLDER [--num 10] [--job both|cup|nothing] [--seed 0]

Stands in for a camera: nothing here knows of graphs or rewards. The places, the order of the jobs, the pace and the
pauses are drawn at random, and the image is noisy.
"""

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

from graphrl_jax.viz.video import write_video

WIDTH, HEIGHT, FRAME_RATE = 320, 240, 20
COLOURS = {
    "desk": (236, 228, 214),
    "hand": (60, 64, 72),
    "tray": (126, 190, 140),
    "cup": (214, 69, 65),
    "book": (58, 110, 190),
}
SIZES = {"hand": (60, 60), "tray": (96, 76), "cup": (26, 26), "book": (44, 32)}
OPENING = 40
"""Degrees by which the hand's ring is open, up and down from its right side."""
JOBS = {"both": ("cup", "book"), "cup": ("cup",), "nothing": ()}
NOISE = 4.0
"""Standard deviation of the image's noise, in grey levels."""


def scene(draw: np.random.Generator) -> dict[str, np.ndarray]:
    """Centres (x, y) of tray, cup, book and hand, in pixels; cup and book lie apart, on the free side of the desk."""
    tray = np.array([235.0, 120.0]) + draw.uniform(-8, 8, 2)
    while True:
        cup, book, hand = draw.uniform((40, 40), (150, HEIGHT - 40), (3, 2))
        if np.abs(cup - book).max() > 50:
            return {"tray": tray, "cup": cup, "book": book, "hand": hand}


def path(start: np.ndarray, end: np.ndarray, seconds: float) -> Iterator[np.ndarray]:
    """Places on the way from start to end, frame by frame: slow at both ends."""
    count = max(round(seconds * FRAME_RATE), 1)
    for share in np.arange(1, count + 1) / count:
        yield start + (end - start) * share * share * (3 - 2 * share)


def motion(draw: np.random.Generator, moved: tuple[str, ...]) -> Iterator[dict[str, np.ndarray]]:
    """The places of all things in every frame; the hand goes to cup and book, and carries only those to be moved."""
    places = scene(draw)
    sides = dict(zip(("cup", "book"), draw.permutation([-1, 1]), strict=True))

    def pause(seconds: float) -> Iterator[dict[str, np.ndarray]]:
        for _ in range(round(seconds * FRAME_RATE)):
            yield dict(places)

    def travel(
        names: tuple[str, ...], start: np.ndarray, end: np.ndarray, seconds: float
    ) -> Iterator[dict[str, np.ndarray]]:
        for place in path(start, end, seconds):
            places.update(dict.fromkeys(names, place))
            yield dict(places)

    yield from pause(draw.uniform(0.2, 0.6))
    for name in draw.permutation(list(sides)):
        yield from travel(("hand",), places["hand"], places[name], draw.uniform(1.2, 1.8))
        spot = places["tray"] + (23 * sides[name], draw.uniform(-12, 12))
        carried = ("hand", name) if name in moved else ("hand",)
        yield from travel(carried, places[name], spot, draw.uniform(1.8, 2.6))
        yield from pause(draw.uniform(0.1, 0.3))
    yield from travel(("hand",), places["hand"], draw.uniform((40, 40), (150, HEIGHT - 40)), 0.8)
    yield from pause(0.3)


def image(places: dict[str, np.ndarray], draw: np.random.Generator) -> np.ndarray:
    """A frame (HEIGHT, WIDTH, 3) uint8, seen from above; the hand is a ring, so that what it holds stays visible."""
    canvas = Image.new("RGB", (WIDTH, HEIGHT), COLOURS["desk"])
    pen = ImageDraw.Draw(canvas)

    def corners(name: str) -> tuple[float, ...]:
        (x, y), (width, height) = places[name], SIZES[name]
        return x - width / 2, y - height / 2, x + width / 2, y + height / 2

    pen.rounded_rectangle(corners("tray"), 8, fill=COLOURS["tray"])
    pen.rounded_rectangle(corners("book"), 3, fill=COLOURS["book"])
    pen.ellipse(corners("cup"), fill=COLOURS["cup"])
    pen.arc(corners("hand"), OPENING, 360 - OPENING, fill=COLOURS["hand"], width=9)
    noisy = np.asarray(canvas, np.float32) + draw.normal(0, NOISE, (HEIGHT, WIDTH, 1))
    return noisy.clip(0, 255).astype(np.uint8)


def main() -> None:
    """Writes the videos."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("folder", type=Path)
    options.add_argument("--num", type=int, default=10, help="number of videos (default: 10)")
    options.add_argument("--job", choices=JOBS, default="both", help="what is put on the tray (default: both)")
    options.add_argument("--seed", type=int, default=0, help="source of all randomness (default: 0)")
    asked = options.parse_args()
    for number in range(asked.num):
        draw = np.random.default_rng([asked.seed, number])
        frames = [image(places, draw) for places in motion(draw, JOBS[asked.job])]
        write_video(np.stack(frames), asked.folder / f"{asked.job}_{number + 1}.mp4", FRAME_RATE)


if __name__ == "__main__":
    main()
