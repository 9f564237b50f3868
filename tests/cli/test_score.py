"""`graphrl score`: recordings of Match Regions under the released reward."""

import json

import jax
import numpy as np
import pytest
from pyarrow import parquet

from graphrl_jax import cli
from graphrl_jax.cli import score
from graphrl_jax.perception.detector import Detection
from graphrl_jax.registry import make_task
from graphrl_jax.reward.model import RewardModel
from graphrl_jax.viz.video import write_video
from tests.helpers import hub
from tests.helpers.commands import call, rejected
from tests.helpers.robot_datasets import FRAME_RATE, LENGTHS, write_lerobot_v30

MODEL = "checkpoints/match_regions_graph"


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    """A whole demonstration and its first half, at twice the frame rate of the task."""
    folder = tmp_path_factory.mktemp("recordings")
    demos = make_task("match_regions").demonstrate(jax.random.key(3), 1, image_size=256)
    frames = np.repeat(np.asarray(demos.images(256))[0, : demos.lengths[0]], 2, axis=0)
    write_video(frames[: len(frames) // 4 * 2], folder / "half.mp4", 16.0)
    write_video(frames, folder / "whole.mp4", 16.0)
    return folder


def test_recordings_are_scored_and_ranked(recordings, tmp_path):
    answer = call(cli.main, "score", MODEL, recordings, "--out", tmp_path / "scores")
    first, second = answer["recordings"]
    assert (first["recording"], second["recording"]) == (f"{recordings}/whole.mp4", f"{recordings}/half.mp4")
    assert first["looks_like_success"] and not second["looks_like_success"]
    assert first["final_progress"] > second["final_progress"] and first["value_order_correlation"] > 0.8
    scores = json.loads((tmp_path / "scores" / "scores.json").read_text())
    assert scores["end_reward"] == RewardModel.load(MODEL).card.end_reward
    whole = scores["recordings"][0]
    assert whole["coverage"]["robot"] == 1 and whole["episode_index"] == 1

    page = (tmp_path / "scores" / "report.html").read_text()
    assert f"Progress of {recordings.name}, scored by the reward model match_regions_graph" in page
    assert page.count("<section") == 2 and page.index("whole.mp4") < page.index("half.mp4")

    table = parquet.read_table(tmp_path / "scores" / "progress.parquet")
    assert table.schema.metadata[b"reward_model_path"] == MODEL.encode()
    rows = table.to_pydict()
    # The videos have twice the model's frame rate, so that every frame of it is the first of two.
    frames = [2 * row["frames"] for row in sorted(scores["recordings"], key=lambda row: row["episode_index"])]
    np.testing.assert_array_equal(rows["index"], np.arange(sum(frames)))
    np.testing.assert_array_equal(rows["episode_index"], np.repeat([0, 1], frames))
    np.testing.assert_array_equal(rows["frame_index"], np.concatenate([np.arange(count) for count in frames]))
    np.testing.assert_allclose(np.diff(rows["seconds"][: frames[0]]), 1 / 16, atol=1e-6)
    progress, reward = np.array(rows["progress_sparse"]), np.array(rows["reward"])
    np.testing.assert_allclose(progress, np.clip(1 + reward, 0, 1), atol=1e-6)
    found = parquet.read_table(tmp_path / "scores" / "subtasks.parquet").to_pylist()
    for row in scores["recordings"]:
        own = found[row["episode_index"]]
        first = [0, *(2 * frame for frame in row["subtasks"])]
        assert own["sparse_subtask_start_frames"] == first
        assert own["sparse_subtask_end_frames"] == [*(frame - 1 for frame in first[1:]), 2 * row["frames"] - 1]
        np.testing.assert_allclose(own["sparse_subtask_start_times"], np.array(first) / 16)
    shares = json.loads((tmp_path / "scores" / "temporal_proportions_sparse.json").read_text())
    assert len(shares) == 1 + max(len(row["subtasks"]) for row in scores["recordings"]) > 1
    np.testing.assert_allclose(sum(shares.values()), 1.0)
    assert rows["active"][0] == [] and {"star", "square"} <= set(rows["active"][-1])


class Shades:
    """Finds a star whose place is told by a frame's shade, and a robot."""

    def detect(self, frame: np.ndarray) -> list[Detection]:
        place = frame[..., 1].mean() / 255
        return [Detection(2, np.array([place, 0.5, 0.1, 0.1])), Detection(1, np.array([0.5, 0.5, 0.1, 0.1]))]


def test_the_rows_of_a_dataset_of_robots_are_its_frames(tmp_path, monkeypatch):
    monkeypatch.setattr(score, "_detector", lambda request, card: Shades())
    write_lerobot_v30(tmp_path / "dataset")
    camera = ["--camera", "observation.images.top"]
    answer = call(cli.main, "score", MODEL, tmp_path / "dataset", *camera, "--out", tmp_path / "scores")
    assert len(answer["recordings"]) == len(LENGTHS)
    rows = parquet.read_table(tmp_path / "scores" / "progress.parquet").to_pydict()
    frames = np.concatenate([np.arange(length) for length in LENGTHS])
    np.testing.assert_array_equal(rows["index"], np.arange(sum(LENGTHS)))
    np.testing.assert_array_equal(rows["episode_index"], np.repeat(np.arange(len(LENGTHS)), LENGTHS))
    np.testing.assert_array_equal(rows["frame_index"], frames)
    np.testing.assert_allclose(rows["seconds"], frames / FRAME_RATE, atol=1e-6)
    episodes = parquet.read_table(tmp_path / "scores" / "subtasks.parquet").to_pydict()
    assert [ends[-1] for ends in episodes["sparse_subtask_end_frames"]] == [length - 1 for length in LENGTHS]


def test_a_model_of_the_hub_scores_by_its_name(capsys, recordings, monkeypatch, tmp_path):
    model, package = RewardModel.load(MODEL), hub.put_in_place(monkeypatch, tmp_path / "hub")
    monkeypatch.chdir(tmp_path)
    model.push_to_hub("someone/regions")
    arguments = ["score", "someone/regions", recordings / "half.mp4", "--out", tmp_path / "scores"]
    package.fault = ConnectionError("no network")
    assert "someone/regions is no folder here" in rejected(capsys, arguments, cli.main)
    assert not (tmp_path / "scores").exists()
    package.fault = None
    assert not call(cli.main, *arguments)["recordings"][0]["looks_like_success"]
    assert json.loads((tmp_path / "scores" / "scores.json").read_text())["model"] == "someone/regions"
    assert not (tmp_path / "someone").exists()


def test_what_cannot_be_scored_is_one_sentence(capsys, recordings, tmp_path):
    out = tmp_path / "scores"
    assert "holds no reward model" in rejected(capsys, ["score", recordings, recordings, "--out", out], cli.main)
    (tmp_path / "objects.toml").write_text('name = "a"\nframe_rate = 8\n[[objects]]\nname = "b"\n')
    other = ["score", MODEL, recordings, "--objects", tmp_path / "objects.toml", "--out", out]
    assert "objects.toml has other objects than checkpoints/match_regions_graph" in rejected(capsys, other, cli.main)
    assert not out.exists()
    out.mkdir()
    assert "exists already" in rejected(capsys, ["score", MODEL, recordings, "--out", out], cli.main)
