"""`graphrl stages`: subtasks of demonstrations."""

import json
from dataclasses import replace

import numpy as np
import pytest

from graphrl_jax import cli
from graphrl_jax.demonstrations import load
from graphrl_jax.reward.config import SUBTASK_METHODS
from graphrl_jax.reward.model import RewardModel
from tests.helpers import hub
from tests.helpers.commands import call, rejected

pytestmark = pytest.mark.usefixtures("outside_package")


@pytest.mark.parametrize("method", SUBTASK_METHODS)
def test_subtasks_of_demonstrations_without_labels(capsys, demos_file, tmp_path, finished, method):
    bare = replace(load(demos_file), events=None, event_names=(), kinds=None)
    file, out = tmp_path / "bare.npz", tmp_path / "subtasks.json"
    bare.save(file)
    printed = call(cli.main, "stages", finished, "--demos", file, "--method", method, "--out", out)
    assert printed == {"out": str(out), "demonstrations": len(bare)}
    rows = json.loads(out.read_text())["subtasks"]
    assert [row["length"] for row in rows] == bare.lengths.tolist()
    log = [line.partition("] ")[2] for line in capsys.readouterr().err.splitlines()]
    for number, row in enumerate(rows, start=1):
        told = f"boundaries at {', '.join(f'{second:.1f}' for second in row['seconds'])} s"
        assert f"demonstration {number} of {len(rows)}: {told if row['seconds'] else 'no boundaries'}" in log
        assert all(0 < frame < row["length"] for frame in row["boundaries"])
        np.testing.assert_allclose(np.array(row["seconds"]) * bare.frame_rate, row["boundaries"])


def test_a_model_of_the_hub_has_no_folder_to_write_to(demos_file, finished, monkeypatch, tmp_path):
    hub.put_in_place(monkeypatch, tmp_path / "hub")
    monkeypatch.chdir(tmp_path)
    RewardModel.load(finished).push_to_hub("someone/carry")
    assert call(cli.main, "stages", "someone/carry", "--demos", demos_file)["out"] == "subtasks.json"
    assert (tmp_path / "subtasks.json").exists() and not (tmp_path / "someone").exists()


def test_an_unknown_way_to_find_subtasks_is_one_sentence(capsys, demos_file, finished):
    message = rejected(capsys, ["stages", finished, "--demos", demos_file, "--method", "guess"], cli.main)
    assert "'guess'" in message and "change_points" in message
