"""Demonstrations of robomimic come in order of their numbers, with their own pictures; other files are refused."""

import importlib
import json

import h5py
import numpy as np
import pytest

from graphrl_jax.demonstrations import load
from graphrl_jax.perception.importers.convert import Source, guess_format
from graphrl_jax.perception.importers.recording import ImportFailure
from tasks.match_regions.objects import OBJECTS
from tests.helpers.importing import FRAMES, refused, run
from tests.helpers.robot_datasets import CAMERAS, pictures, write_robomimic


def read(path, camera=None):
    return list(Source(path, camera=camera).recordings(OBJECTS))


@pytest.fixture
def path(tmp_path):
    write_robomimic(tmp_path / "demo.hdf5")
    return tmp_path / "demo.hdf5"


@pytest.mark.parametrize("camera, shown", [("agentview", CAMERAS[0]), ("wrist", CAMERAS[1])])
def test_demonstrations_come_in_order_of_their_numbers(path, camera, shown):
    assert guess_format(path) == guess_format(path.parent) == "robomimic"
    found = read(path.parent, camera)
    assert [recording.source.name for recording in found] == ["demo_0", "demo_2", "demo_10"]
    for recording, episode, length in zip(found, (0, 2, 10), (4, 3, 5), strict=True):
        np.testing.assert_array_equal(recording.frames, pictures(episode % 4, length, shown))
        assert recording.frame_rate == 20.0 and recording.success


def test_a_file_becomes_demonstrations(tmp_path):
    with h5py.File(tmp_path / "demo.hdf5", "w") as file:
        demo = file.create_group("data/demo_1")
        demo.attrs["num_samples"] = len(FRAMES)
        demo.create_dataset("obs/agentview_image", data=FRAMES, compression="gzip")
    run(tmp_path / "demo.hdf5", "--out", tmp_path / "demos.npz", "--frame-rate", 5)
    run(tmp_path / "demo.hdf5", "--out", tmp_path / "usual.npz", "--camera", "agentview")
    demos, usual = load(tmp_path / "demos.npz"), load(tmp_path / "usual.npz")
    star = demos.boxes[0, :, OBJECTS.names.index("star"), 0]
    assert np.all(np.diff(star) < 0) and demos.events is None
    assert (demos.frame_rate, usual.frame_rate) == (5.0, 8.0)


@pytest.mark.parametrize(
    "env_args, expected",
    [
        (None, None),
        ({"env_name": "Lift"}, None),
        ({"env_kwargs": {}}, None),
        ({"env_kwargs": None}, None),
        ({"env_kwargs": {"control_freq": 12.5}}, 12.5),
    ],
)
def test_the_frame_rate_is_the_control_frequency(path, env_args, expected):
    with h5py.File(path, "a") as file:
        del file["data"].attrs["env_args"]
        if env_args is not None:
            file["data"].attrs["env_args"] = np.bytes_(json.dumps(env_args))
    assert {recording.frame_rate for recording in read(path, "wrist")} == {expected}


def test_a_camera_is_chosen_by_its_name(path, capsys):
    says = f"{path} has the cameras agentview, wrist; --camera says which to read"
    with pytest.raises(ImportFailure, match=says):
        read(path)
    assert f"--camera is 'front'; {path} has agentview, wrist" in refused(capsys, path, "--camera", "front")
    with h5py.File(path, "a") as file:
        del file["data/demo_2/obs/wrist_image"]
    with pytest.raises(ImportFailure, match="--camera is 'wrist'; .*demo_2 has agentview"):
        read(path, "wrist")
    with h5py.File(path, "a") as file:
        for demo in file["data"].values():
            for name in list(demo["obs"]):
                del demo["obs"][name]
    with pytest.raises(ImportFailure, match="has no camera"):
        read(path)


def set_pictures(file, values):
    del file["data/demo_2/obs/agentview_image"]
    file["data/demo_2/obs/agentview_image"] = values


BREAKS = {
    "group data is missing": lambda file: file.move("data", "demos"),
    "data/demo_2: group obs is missing": lambda file: file.move("data/demo_2/obs", "data/demo_2/observations"),
    "data/take_1 is no demonstration; allowed: groups demo_0": lambda file: file.create_group("data/take_1"),
    "data/demo_02 is no demonstration": lambda file: file.create_group("data/demo_02"),
    "data/demo_3 is no demonstration": lambda file: file.create_dataset("data/demo_3", data=[1]),
    "data/demo_2: num_samples is None": lambda file: file["data/demo_2"].attrs.__delitem__("num_samples"),
    "data/demo_2: num_samples is 0; allowed: whole numbers from 1": lambda file: file["data/demo_2"].attrs.update(
        num_samples=0
    ),
    "total is 13; its demonstrations have 12 samples": lambda file: file["data"].attrs.update(total=13),
    "total is 12.5; allowed: whole numbers": lambda file: file["data"].attrs.update(total=12.5),
    "env_args: no JSON": lambda file: file["data"].attrs.update(env_args="{"),
    "env_args: control_freq is 0; allowed: finite numbers above 0": lambda file: file["data"].attrs.update(
        env_args='{"env_kwargs": {"control_freq": 0}}'
    ),
    "agentview_image has 2 pictures; allowed: 3, as num_samples says": lambda file: set_pictures(file, pictures(2, 2)),
    "is of shape (3, 48, 64, 3) and type float32; allowed: (N, H, W, 3) of uint8": lambda file: set_pictures(
        file, pictures(2, 3).astype(np.float32)
    ),
    "is of shape (3, 3, 48, 64) and type uint8": lambda file: set_pictures(file, pictures(2, 3).transpose(0, 3, 1, 2)),
    "is of shape () and type None": lambda file: set_pictures(file, h5py.SoftLink("/data/demo_2")),
    "no HDF5 that can be read": lambda file: set_pictures(file, h5py.SoftLink("/nowhere")),
}


@pytest.mark.parametrize("says", BREAKS)
def test_files_that_are_not_as_robomimics_are_refused(path, capsys, says):
    with h5py.File(path, "a") as file:
        BREAKS[says](file)
    message = refused(capsys, path, "--camera", "agentview", "--task", "shoes_in_box")
    assert ("demo.hdf5" in message and says in message) or "so nothing finds them in images" in message
    with pytest.raises(ImportFailure) as failure:
        read(path, "agentview")
    assert says in str(failure.value)


@pytest.mark.parametrize("share", [0.0, 0.3, 0.9])
def test_damaged_files_are_refused(path, share):
    raw = path.read_bytes()
    path.write_bytes(raw[: int(share * len(raw))])
    with pytest.raises(ImportFailure, match="demo.hdf5: no HDF5 that can be read"):
        read(path, "agentview")


def test_an_empty_file_holds_no_demonstrations(tmp_path, capsys):
    with h5py.File(tmp_path / "demo.hdf5", "w") as file:
        file.create_group("data")
    assert "holds no demonstrations" in refused(capsys, tmp_path / "demo.hdf5")


def test_without_h5py_one_sentence_says_how_to_get_it(path, monkeypatch):
    def missing(name):
        raise ImportError(name)

    monkeypatch.setattr(importlib, "import_module", missing)
    with pytest.raises(ImportFailure, match=r'need the package h5py: pip install "graphrl_jax\[robomimic\]"'):
        read(path)


def test_a_video_beside_a_file_needs_a_choice(path):
    (path.parent / "take.mp4").touch()
    with pytest.raises(ImportFailure, match="holds video and robomimic; --format says which to read"):
        guess_format(path.parent)
