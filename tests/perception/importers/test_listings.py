"""Images that a file lists are recordings by group and frame number."""

from fractions import Fraction
from pathlib import Path, PurePath

import numpy as np
import pytest

from graphrl_jax.perception.detector import Detection
from graphrl_jax.perception.importers.listings import ListedImage, file_name, listed_recordings
from graphrl_jax.perception.importers.recording import ImportFailure


def listed(name, group="", number=None):
    """An image in which the class id says its place in the list."""
    return lambda index: ListedImage(
        PurePath(name),
        group,
        [Detection(index, np.zeros(4, np.float32))],
        None if number is None else Fraction(number),
    )


def read(*images):
    """Sources of the recordings, and the place in the list of the image of every frame."""
    made = [image(index) for index, image in enumerate(images)]
    return [
        (str(one.source), [frame[0].class_id if frame else None for frame in one.detections])
        for one in listed_recordings(Path("list"), made)
    ]


def test_groups_are_recordings_in_natural_order():
    images = [
        listed("10.png", "take_10"),
        listed("2.png", "take_10"),
        listed("1.png", "take_2"),
        listed("3.png", "take_10"),
    ]
    assert read(*images) == [("list/take_2", [2]), ("list/take_10", [1, 3, *[None] * 6, 0])]
    images = [listed("a_2.png"), listed("b_1.png"), listed("a_1.png"), listed("b_2.png")]
    assert read(*images) == [("list/a_1.png", [2, 0]), ("list/b_1.png", [1, 3])]


def test_numbers_decide_if_all_images_have_one():
    assert read(listed("take.mp4", "v", 4), listed("take.mp4", "v", 2)) == [("list/v", [1, 0])]
    assert read(listed("2.png", number=0), listed("1.png")) == [("list", [1, 0])]


@pytest.mark.parametrize(
    "images, says",
    [
        ([listed("1.png"), listed("1.png")], "list: 1.png is listed twice; allowed: one image for each file"),
        ([listed("a.png"), listed("b.png")], "list: a.png: the name holds no frame number"),
        ([listed("a.png", number=3), listed("b.png", number=3)], "both are frame 3"),
    ],
)
def test_what_is_unclear_is_refused(images, says):
    with pytest.raises(ImportFailure, match=says):
        read(*images)


def test_paths_of_windows_are_paths():
    assert file_name("take\\cam\\1.png") == file_name("take/cam/1.png") == PurePath("take/cam/1.png")
