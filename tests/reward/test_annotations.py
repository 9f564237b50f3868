"""Subtasks as labels of episodes: they go into a dataset as the documentation says, and come out of it again."""

import json
import re
import shutil

import numpy as np
import pytest
from pyarrow import parquet

from graphrl_jax.perception.importers.lerobot import read_lerobot
from graphrl_jax.reward.annotations import Subtasks, proportions, subtasks_of, write_subtasks
from tests.helpers.commands import contents
from tests.helpers.outside_package import REPOSITORY
from tests.helpers.robot_datasets import CAMERAS, FRAME_RATE, LENGTHS, write_lerobot_v30

PREFIX = "sparse_subtask_"


@pytest.mark.parametrize(
    ("shown", "length", "first", "last"),
    [
        (range(6), 6, [0, 2, 5], [1, 4, 5]),
        (range(0, 12, 2), 12, [0, 4, 10], [3, 9, 11]),  # half as many frames were scored
        ([0, 0, 1, 1, 2, 2], 3, [0, 1, 2], [0, 1, 2]),  # twice as many
        ([0, 0, 0, 0, 0, 1], 2, [0, 1], [0, 1]),  # the second subtask lies between two frames
        ([0] * 6, 1, [0], [0]),
    ],
)
def test_frames_are_those_of_the_episode(shown, length, first, last):
    found = subtasks_of(np.array([0, 0, 1, 1, 1, 2]), np.array(shown), length, 10.0)
    assert (found.first.tolist(), found.last.tolist()) == (first, last)


def test_shares_are_means_over_all_episodes():
    # A half and a half; a quarter, a half and a quarter.
    episodes = [subtasks(4, 2), subtasks(8, 2, 6)]
    assert proportions(episodes) == {"subtask_1": 0.375, "subtask_2": 0.5, "subtask_3": 0.125}
    assert proportions(episodes[:1]) == {"subtask_1": 0.5, "subtask_2": 0.5}


def subtasks(length: int, *boundaries: int) -> Subtasks:
    """The subtasks of an episode of a dataset; a boundary is the first frame of a new one."""
    numbers = np.searchsorted(boundaries, np.arange(length), side="right")
    return subtasks_of(numbers, np.arange(length), length, FRAME_RATE)


def test_the_columns_are_lerobots(tmp_path):
    write_subtasks(tmp_path, [subtasks(4, 1), subtasks(3)])
    table = parquet.read_table(tmp_path / "subtasks.parquet")
    types = {field.name: str(field.type) for field in table.schema}
    assert types.pop("episode_index") == "int64"
    assert {name.removeprefix(PREFIX): kind.split(": ")[1] for name, kind in types.items()} == {
        "names": "string>",
        "start_times": "double>",
        "end_times": "double>",
        "start_frames": "int64>",
        "end_frames": "int64>",
    }
    first, second = table.to_pylist()
    assert first == {
        "episode_index": 0,
        f"{PREFIX}names": ["subtask_1", "subtask_2"],
        f"{PREFIX}start_times": [0.0, 0.1],
        f"{PREFIX}end_times": [0.0, 0.3],
        f"{PREFIX}start_frames": [0, 1],
        f"{PREFIX}end_frames": [0, 3],
    }
    assert (second["episode_index"], second[f"{PREFIX}names"], second[f"{PREFIX}end_frames"]) == (1, ["subtask_1"], [2])
    shares = json.loads((tmp_path / "temporal_proportions_sparse.json").read_text())
    assert list(shares) == ["subtask_1", "subtask_2"] and shares == {"subtask_1": 0.625, "subtask_2": 0.375}


def test_labels_are_joined_to_a_copy_and_read_again(tmp_path, monkeypatch):
    """The block of docs/video.md joins them."""
    (block,) = re.findall(
        r"^```python\n([^`]*subtasks\.parquet.*?)^```$",
        (REPOSITORY / "docs" / "video.md").read_text(),
        re.MULTILINE | re.DOTALL,
    )
    write_lerobot_v30(tmp_path / "dataset")
    before = contents(tmp_path / "dataset")
    shutil.copytree(tmp_path / "dataset", tmp_path / "copy")
    # Of episodes of 4, 3 and 5 frames, in two files.
    write_subtasks(tmp_path / "scores", [subtasks(LENGTHS[0], 1, 2), subtasks(LENGTHS[1]), subtasks(LENGTHS[2], 3)])
    monkeypatch.chdir(tmp_path)
    exec(compile(block, "video.md", "exec"), {})
    found = list(read_lerobot([tmp_path / "copy" / "meta" / "info.json"], CAMERAS[0]))
    assert [one.events for one in found] == [
        {"subtask_1": 0, "subtask_2": 1, "subtask_3": 3},
        {"subtask_1": 2},
        {"subtask_1": 2, "subtask_2": 4},
    ]
    assert all(len(one.frames) == length for one, length in zip(found, LENGTHS, strict=True))
    assert (tmp_path / "copy/meta/temporal_proportions_sparse.json").exists()
    assert contents(tmp_path / "dataset") == before
