"""Labels of subtasks become the frames at which they end."""

import pytest

from graphrl_jax.perception.importers.recording import ImportFailure
from graphrl_jax.perception.importers.subtask_labels import SUBTASK_COLUMNS, has_subtasks, subtask_ends


def row(index=0, prefix="sparse_", names=("reach", "push"), starts=(0, 4), ends=(3, 9), length=10):
    labels = {"subtask_names": list(names), "subtask_start_frames": list(starts), "subtask_end_frames": list(ends)}
    return {"episode_index": index, "length": length, **{prefix + name: value for name, value in labels.items()}}


@pytest.mark.parametrize("prefix", ["dense_", "sparse_", ""])
def test_a_subtask_is_done_in_its_last_frame(prefix):
    assert subtask_ends([row(0, prefix), row(1, prefix, ends=(5, 10))]) == [
        {"reach": 3, "push": 9},
        {"reach": 5, "push": 9},
    ]
    assert row(0, prefix).keys() <= {"episode_index", "length", *SUBTASK_COLUMNS}


def test_the_finest_labels_that_all_episodes_have_count():
    dense = row(0, "dense_", ("a", "b", "c"), (0, 2, 4), (1, 3, 5))
    both = {**row(0), **dense}
    assert subtask_ends([both, both]) == [{"a": 1, "b": 3, "c": 5}] * 2
    assert subtask_ends([both, row(1)]) == [{"reach": 3, "push": 9}] * 2
    assert subtask_ends([dense, row(1)]) == subtask_ends([row(0), {"episode_index": 1, "length": 3}]) == [None, None]
    assert subtask_ends([row(names=(), starts=(), ends=())]) == [None] and subtask_ends([]) == []
    assert has_subtasks(dense) and not has_subtasks({"sparse_subtask_names": None, "length": 3})


def test_a_subtask_that_comes_again_has_a_number():
    again = row(names=("reach", "push", "reach", "reach"), starts=(0, 2, 4, 6), ends=(1, 3, 5, 7))
    assert subtask_ends([again]) == [{"reach": 1, "push": 3, "reach 2": 5, "reach 3": 7}]


@pytest.mark.parametrize(
    "values, says",
    [
        ({"ends": (3, 11)}, "episode 7: subtask 'push' is at frames 4 to 11; allowed: 0 to 10"),
        ({"starts": (0, 10)}, "subtask 'push' is at frames 10 to 9"),
        ({"starts": (-1, 4)}, "subtask 'reach' is at frames -1 to 3"),
        ({"ends": (3, None)}, "subtask 'push' is at frames 4 to None"),
        ({"ends": (3,)}, "2 sparse_subtask_names, 2 sparse_subtask_start_frames, 1 sparse_subtask_end_frames"),
    ],
)
def test_labels_outside_their_episode_are_refused(values, says):
    with pytest.raises(ImportFailure, match=says):
        subtask_ends([row(7, **values)])
