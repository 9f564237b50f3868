"""Episodes of a LeRobotDataset have their own frames, and what does not fit together is refused."""

import json
from inspect import signature

import numpy as np
import pytest

from graphrl_jax.demonstrations import load
from graphrl_jax.perception.importers.convert import Source, guess_format
from graphrl_jax.perception.importers.recording import ImportFailure
from tasks.match_regions.objects import OBJECTS
from tests.helpers.importing import FRAMES, refused, run
from tests.helpers.robot_datasets import (
    CAMERAS,
    FRAME_RATE,
    LENGTHS,
    SIZE,
    are_pictures,
    edit_info,
    edit_parquet,
    pictures,
    png,
    write_lerobot_v21,
    write_lerobot_v30,
    write_mp4,
)

DATA = "data/chunk-000/file-000.parquet"
EPISODES = "meta/episodes/chunk-000/file-000.parquet"
VIDEO = f"videos/{CAMERAS[0]}/chunk-000/file-000.mp4"


def read(folder, camera=None):
    return list(Source(folder, camera=camera).recordings(OBJECTS))


def refusal(folder, camera=CAMERAS[0]):
    """The sentence that says what is wrong."""
    with pytest.raises(ImportFailure) as failure:
        read(folder, camera)
    return str(failure.value)


@pytest.fixture
def dataset(tmp_path):
    write_lerobot_v30(tmp_path)
    return tmp_path


def check(recordings, camera=CAMERAS[0]):
    assert len(recordings) == len(LENGTHS)
    for episode, (recording, length) in enumerate(zip(recordings, LENGTHS, strict=True)):
        assert are_pictures(recording.frames, episode, length, camera)
        assert recording.source.name == f"episode_{episode}"
        assert recording.frame_rate == FRAME_RATE and recording.success == (episode != 1)
        assert recording.notes == () and recording.events is None


@pytest.mark.parametrize("options", [{}, {"codec": "libaom-av1"}, {"dtype": "image"}, {"drift": 0.02}])
@pytest.mark.parametrize("camera", CAMERAS)
def test_episodes_of_shared_files_have_their_own_frames(tmp_path, options, camera):
    write_lerobot_v30(tmp_path, **options)
    assert guess_format(tmp_path) == "lerobot"
    check(read(tmp_path, camera), camera)


def test_episodes_with_a_file_each_have_their_own_frames(tmp_path):
    write_lerobot_v21(tmp_path)
    check(read(tmp_path))


def test_one_episode_is_in_memory_at_a_time(dataset):
    """The second file is not opened before its episode's turn."""
    found = Source(dataset, camera=CAMERAS[0]).recordings(OBJECTS)
    next(found)
    (dataset / VIDEO.replace("file-000", "file-001")).unlink()
    next(found)
    with pytest.raises(ImportFailure, match="no video that can be read"):
        next(found)


def test_a_dataset_becomes_demonstrations(tmp_path, capsys):
    folder, out = tmp_path / "dataset", tmp_path / "demos.npz"
    write_lerobot_v30(folder, (4, 3), CAMERAS[:1], dtype="image")
    features = json.loads((folder / "meta/info.json").read_text())["features"]
    features[CAMERAS[0]]["shape"] = list(FRAMES.shape[1:])
    edit_info(folder, features=features)
    for file, rows in ((0, 4), (1, 3)):
        for row in range(rows):
            path = folder / f"data/chunk-000/file-{file:03d}.parquet"
            edit_parquet(path, row, **{CAMERAS[0]: png(FRAMES[row])})
    for row, names, ends in ((0, ["reach", "push"], [1, 4]), (1, ["reach", "rest"], [0, 2])):
        path = folder / EPISODES
        starts = [0, ends[0]]
        edit_parquet(path, row, sparse_subtask_names=names, sparse_subtask_start_frames=starts)
        edit_parquet(path, row, sparse_subtask_end_frames=ends)
    run(folder, "--out", out)
    demos = load(out)
    np.testing.assert_array_equal(demos.lengths, [4, 3])
    np.testing.assert_array_equal(demos.success, [True, False])
    assert demos.frame_rate == FRAME_RATE and demos.event_names == ("reach", "push", "rest")
    np.testing.assert_array_equal(demos.events, [[1, 3, -1], [0, -1, 2]])
    assert "episode_1: 3 frames" in " ".join(capsys.readouterr().err.split())


def test_a_camera_is_chosen_by_its_name(dataset, tmp_path, capsys):
    source = tmp_path / "."
    assert f"has the cameras {CAMERAS[0]}, {CAMERAS[1]}; --camera says which to read" in refusal(dataset, None)
    assert f"--camera is 'front'; {dataset} has {CAMERAS[0]}, {CAMERAS[1]}" in refused(
        capsys, source, "--camera", "front"
    )
    features = json.loads((dataset / "meta/info.json").read_text())["features"]
    edit_info(dataset, features={**features, CAMERAS[1]: {**features[CAMERAS[1]], "info": {"is_depth_map": True}}})
    check(read(dataset))
    edit_info(dataset, features={name: features[name] for name in ("observation.state", "next.success")})
    assert "has no camera" in refusal(dataset, None)


def test_a_camera_is_refused_where_it_changes_nothing(tmp_path, capsys):
    write_mp4(tmp_path / "take.mp4", pictures(0, 3))
    message = refused(capsys, tmp_path / "take.mp4", "--camera", "top")
    assert "--camera changes nothing with format video, whose files have one view; leave it out" in message


def test_the_order_of_a_shape_is_that_of_its_names(dataset):
    features = json.loads((dataset / "meta/info.json").read_text())["features"]
    height, width = SIZE
    for shape, names in (
        ([3, *SIZE], ["channel", "height", "width"]),
        ([width, height, 3], ["width", "height", "rgb"]),
    ):
        features[CAMERAS[0]] |= {"shape": shape, "names": names}
        edit_info(dataset, features=features)
        check(read(dataset, CAMERAS[0]))
    for shape in ([*SIZE, 1], [*SIZE], None):
        features[CAMERAS[0]] |= {"shape": shape, "names": None}
        edit_info(dataset, features=features)
        assert f"{CAMERAS[0]}: shape is {shape}; allowed: height, width and 3 channels" in refusal(dataset)
    features[CAMERAS[0]] |= {"shape": [24, 32, 3]}
    edit_info(dataset, features=features)
    assert "frame 0 is 64 x 48; allowed: 32 x 24" in refusal(dataset)


@pytest.mark.parametrize(
    "fields, says",
    [
        ({"codebase_version": "v2.0"}, "codebase_version is 'v2.0'; allowed: v2.1, v3.0"),
        ({"codebase_version": ["v3.0"]}, "codebase_version is ['v3.0']; allowed: v2.1, v3.0"),
        ({"fps": 0}, "fps is 0; allowed: finite numbers above 0"),
        ({"fps": "10"}, "fps is '10'"),
        ({"fps": 20}, "lasts 0.4 s; allowed: 0.2 s, its 4 frames at 20 frames per second"),
        ({"fps": 10**400}, "allowed: finite numbers above 0"),
        ({"features": None}, "features is of type NoneType; allowed: a JSON object"),
        ({"features": {"action": [2]}}, "features: action is [2]; allowed: its dtype, shape and names"),
        ({"total_frames": 13}, "total_frames is 13; its episodes have 12 frames"),
        ({"total_episodes": 4}, "episode 3 is missing, but total_episodes in info.json is 4"),
        ({"total_episodes": 10**15}, "episode 3 is missing, but total_episodes in info.json is 1000000000000000"),
        ({"total_episodes": 2}, "3 episodes are listed, but total_episodes in info.json is 2"),
        ({"total_episodes": True}, "total_episodes is True; allowed: whole numbers from 0"),
        ({"chunks_size": 0}, "chunks_size is 0; allowed: whole numbers from 1"),
        ({"video_path": None}, f"video_path is missing, but {CAMERAS[0]} is a video"),
        ({"data_path": 3}, "data_path is 3; allowed: the pattern of a path"),
        ({"data_path": "data/{episode}.parquet"}, "allowed: the fields chunk_index, file_index"),
        ({"data_path": "data/{chunk_index.real}"}, "allowed: the fields chunk_index, file_index"),
        ({"data_path": "data/{chunk_index:099999d}"}, "allowed: the fields chunk_index, file_index"),
        ({"data_path": "../{chunk_index}.parquet"}, "data_path leads to ../0.parquet; allowed: paths in the dataset's"),
        ({"data_path": "data\\..\\..\\{chunk_index}"}, "allowed: paths in the dataset's folder"),
        ({"video_path": "/{video_key}.mp4"}, "video_path leads to /observation.images.top.mp4"),
        ({"video_path": "C:\\{video_key}.mp4"}, "allowed: paths in the dataset's folder"),
        ({"data_path": "data/{file_index}.parquet"}, "data/0.parquet is missing"),
    ],
)
def test_what_is_wrong_with_the_description_is_said(dataset, fields, says):
    edit_info(dataset, **fields)
    message = refusal(dataset)
    assert says in message and str(dataset) in message and "\n" not in message


@pytest.mark.parametrize("text, says", [("{", "info.json: no JSON"), ("[]", "is of type list; allowed: a JSON object")])
def test_a_description_that_is_no_json_is_refused(dataset, text, says):
    (dataset / "meta/info.json").write_text(text)
    with pytest.raises(ImportFailure, match=says):
        list(Source(dataset, "lerobot").recordings(OBJECTS))


@pytest.mark.parametrize(
    "row, values, says",
    [
        (1, {"episode_index": 0}, "episode 0 is listed twice"),
        (1, {"episode_index": 7}, "episode 1 is missing"),
        (1, {"episode_index": None}, "column episode_index is missing"),
        (1, {"length": 4}, "total_frames is 12; its episodes have 13 frames"),
        (1, {"length": 0}, "length of episode 1 is 0; allowed: whole numbers from 1"),
        (1, {"dataset_from_index": 3}, "episode 1: dataset_from_index is 3; allowed: 4"),
        (0, {"dataset_to_index": 5}, "episode 0: dataset_to_index is 5; allowed: 4"),
        (0, {"data/file_index": 1}, "file-001.parquet: it has 0 rows of episode 0; allowed: 4"),
        (0, {"data/file_index": -1}, "data/file_index is -1; allowed: whole numbers from 0"),
        (1, {f"videos/{CAMERAS[0]}/from_timestamp": 0.3}, "lasts 0.4 s; allowed: 0.3 s, its 3 frames"),
        (1, {f"videos/{CAMERAS[0]}/from_timestamp": float("nan")}, "seconds from 0"),
        (1, {f"videos/{CAMERAS[0]}/to_timestamp": float("inf")}, "lasts inf s; allowed: 0.3 s"),
        (1, {f"videos/{CAMERAS[0]}/file_index": 1}, "file-001.mp4: an episode begins at frame 0, but the one before"),
        (1, {f"videos/{CAMERAS[0]}/to_timestamp": None}, f"column videos/{CAMERAS[0]}/to_timestamp is missing"),
    ],
)
def test_episodes_that_do_not_fit_are_refused(dataset, row, values, says):
    edit_parquet(dataset / EPISODES, row, **values)
    assert says in refusal(dataset)


def test_episodes_that_share_frames_of_a_video_are_refused(dataset):
    times = {f"videos/{CAMERAS[0]}/from_timestamp": 0.3, f"videos/{CAMERAS[0]}/to_timestamp": 0.6}
    edit_parquet(dataset / EPISODES, 1, **times)
    assert "an episode begins at frame 3, but the one before ends with frame 3" in refusal(dataset)


def test_times_that_drift_by_half_a_frame_are_refused(tmp_path):
    write_lerobot_v30(tmp_path, drift=0.06)
    assert "file-000.mp4: it has 7 frames; allowed: 8 or more" in refusal(tmp_path)


@pytest.mark.parametrize(
    "row, values, says",
    [
        (2, {"frame_index": 3}, "row 2: frame_index is 3; allowed: 2"),
        (2, {"episode_index": 1}, "it has 3 rows of episode 0; allowed: 4"),
        (2, {"index": 7}, "row 2: index is 7; allowed: 2"),
        (2, {"timestamp": 0.35}, "row 2: timestamp is 0.35; allowed: 0.2, as there are 10 frames per second"),
        (2, {"frame_index": None}, "column frame_index is missing"),
        (2, {"next.success": None}, "column next.success is missing"),
    ],
)
def test_rows_that_do_not_fit_are_refused(dataset, row, values, says):
    edit_parquet(dataset / DATA, row, **values)
    assert f"{DATA}: {says}" in refusal(dataset)


def test_rows_of_another_file_are_refused(dataset):
    (dataset / DATA.replace("file-000", "file-001")).write_bytes((dataset / DATA).read_bytes())
    assert "file-001.parquet: it has 0 rows of episode 2; allowed: 5" in refusal(dataset)
    edit_parquet(dataset / EPISODES.replace("file-000", "file-001"), 0, **{"data/file_index": 0})
    (dataset / EPISODES).unlink()
    assert "episode 0 is missing" in refusal(dataset)


def test_success_is_that_of_the_last_row(dataset):
    edit_parquet(dataset / DATA, 6, **{"next.success": True})
    edit_parquet(dataset / DATA, 0, **{"next.success": True})
    assert [recording.success for recording in read(dataset, CAMERAS[0])] == [True, True, True]
    for file in range(2):
        edit_parquet(dataset / DATA.replace("file-000", f"file-{file:03d}"), 0, **{"next.success": None})
    features = json.loads((dataset / "meta/info.json").read_text())["features"]
    edit_info(dataset, features={name: one for name, one in features.items() if name != "next.success"})
    assert all(recording.success for recording in read(dataset, CAMERAS[0]))


def test_optional_columns_may_be_missing(dataset):
    for file in range(2):
        path = dataset / DATA.replace("file-000", f"file-{file:03d}")
        edit_parquet(path, 0, timestamp=None, index=None)
    check(read(dataset, CAMERAS[0]))


def test_frames_of_no_episode_are_told(dataset):
    write_mp4(dataset / VIDEO, np.concatenate([pictures(0, 4), pictures(1, 3), pictures(3, 2)]))
    first, *others = read(dataset, CAMERAS[0])
    assert first.notes == (f"{VIDEO}: 2 frames of no episode left out",)
    assert are_pictures(others[0].frames, 1, 3) and others[0].notes == ()


def test_labels_of_some_episodes_are_told_and_left_out(dataset):
    labels = {"subtask_names": ["push"], "subtask_start_frames": [0], "subtask_end_frames": [2]}
    edit_parquet(dataset / EPISODES, 0, **labels)
    first, *others = read(dataset, CAMERAS[0])
    assert first.notes == ("subtasks left out, as other episodes have none",) and first.events is None
    assert [recording.notes for recording in others] == [(), ()]


@pytest.mark.parametrize("share", [0.0, 0.4, 0.8])
def test_a_video_that_breaks_off_is_refused(dataset, share):
    raw = (dataset / VIDEO).read_bytes()
    (dataset / VIDEO).write_bytes(raw[: int(share * len(raw))])
    assert VIDEO in refusal(dataset)


def test_a_video_of_another_rate_is_refused(dataset):
    write_mp4(dataset / VIDEO, pictures(0, 7), rate=20)
    assert "frame 1 is shown at 0.05 s; allowed: 0.1 s" in refusal(dataset)


@pytest.mark.parametrize("file", [DATA, EPISODES])
def test_damaged_files_are_refused(dataset, file):
    raw = (dataset / file).read_bytes()
    for damaged in (raw[: len(raw) // 2], b"", raw[:4] + b"\xff" * 200 + raw[204:]):
        (dataset / file).write_bytes(damaged)
        message = refusal(dataset)
        assert f"{file}: no parquet that can be read" in message and "\n" not in message


def test_pictures_that_are_not_in_the_file_are_refused(tmp_path):
    write_lerobot_v30(tmp_path, dtype="image")
    for cell, says in (
        ({"bytes": None, "path": "0.png"}, "frame 1: the picture is not in the file"),
        ({"bytes": b"none", "path": "0.png"}, "frame 1: no image that can be read"),
        (png(pictures(0, 1)[0, :24]), "frame 1 is 64 x 24; allowed: 64 x 48"),
    ):
        edit_parquet(tmp_path / DATA, 1, **{CAMERAS[0]: cell})
        assert says in refusal(tmp_path)


def test_what_is_wrong_with_separate_files_is_said(tmp_path):
    write_lerobot_v21(tmp_path)
    path, video = tmp_path / "meta/episodes.jsonl", f"videos/chunk-000/{CAMERAS[0]}/episode_000001.mp4"
    whole, raw = path.read_text(), (tmp_path / video).read_bytes()
    for text, says in (
        (whole.replace('"length": 3', '"length": 4'), "total_frames is 12; its episodes have 13 frames"),
        (whole.replace('"length": 3', '"length": "3"'), "length of episode 1 is '3'"),
        (whole + whole.splitlines()[0], "episode 2 is listed twice"),
        (whole.partition("\n")[2], "episode 2 is missing"),
        (whole + "[]", "episodes.jsonl: line 4 is of type list"),
        (whole + "{", "episodes.jsonl: line 4: no JSON"),
    ):
        path.write_text(text)
        assert says in refusal(tmp_path)
    path.write_text(whole)
    write_mp4(tmp_path / video, pictures(1, 2))
    assert f"{video}: it has 2 frames; allowed: 3 or more" in refusal(tmp_path)
    (tmp_path / video).unlink()
    assert f"{video} is missing" in refusal(tmp_path)
    (tmp_path / video).write_bytes(raw)
    edit_info(tmp_path, chunks_size=1000)
    assert "data/chunk-000/episode_000002.parquet is missing" in refusal(tmp_path)
    path.unlink()
    assert "episodes.jsonl: cannot be read" in refusal(tmp_path)


def test_several_datasets_are_read_one_after_the_other(tmp_path):
    for name in ("take_10", "take_2"):
        write_lerobot_v21(tmp_path / name, (2, 3))
    assert [recording.source.relative_to(tmp_path).parts for recording in read(tmp_path)] == [
        (take, episode) for take in ("take_2", "take_10") for episode in ("episode_0", "episode_1")
    ]


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("use_videos", [True, False])
def test_datasets_of_the_librarys_own_writer(tmp_path, use_videos):
    """Twelve episodes at a rate whose frames last no whole number of milliseconds; lerobot 0.3 writes v2.1."""
    library = pytest.importorskip("lerobot.datasets.lerobot_dataset")
    shown = {"shape": (*SIZE, 3), "names": ["height", "width", "channels"]}
    features = {camera: {"dtype": "video" if use_videos else "image", **shown} for camera in CAMERAS}
    features["next.success"] = {"dtype": "bool", "shape": (1,), "names": None}
    dataset = library.LeRobotDataset.create("a/b", 30, features, root=tmp_path / "own", use_videos=use_videos)
    lengths = [3 + episode % 3 for episode in range(12)]
    for episode, length in enumerate(lengths):
        for frame in range(length):
            cells = {camera: pictures(episode % 4, length, camera)[frame] for camera in CAMERAS}
            task = {} if "task" in signature(dataset.add_frame).parameters else {"task": "push"}
            frame_of = {**cells, "next.success": np.array([episode != 1]), **task}
            dataset.add_frame(frame_of) if task else dataset.add_frame(frame_of, "push")
        dataset.save_episode()
    getattr(dataset, "finalize", lambda: None)()
    for camera in CAMERAS:
        found = read(tmp_path / "own", camera)
        assert [recording.success for recording in found] == [episode != 1 for episode in range(12)]
        for episode, (recording, length) in enumerate(zip(found, lengths, strict=True)):
            assert recording.frame_rate == 30 and are_pictures(recording.frames, episode % 4, length, camera)
