"""Sources are read as they are; what is damaged or foreign is one sentence, and nothing is run or written."""

import gzip
import io
import json
import os
import pickle
import subprocess
import sys
from collections import OrderedDict, namedtuple
from pathlib import Path
from types import ModuleType

import imageio.v3 as imageio
import numpy as np
import pytest
from pictures import draw

from graphrl_jax import cli
from graphrl_jax import demonstrations as demonstration_files
from graphrl_jax.importers import magical
from graphrl_jax.importers.convert import Source, guess_format
from graphrl_jax.importers.recording import ImportFailure
from graphrl_jax.video import write_video
from tasks.match_regions.objects import OBJECTS

REAL = Path(__file__).parents[2] / "shared" / "data" / "magical_match_regions"
FRAMES = np.stack([draw(moved={"star": (0.8 - 0.1 * t, -0.7)}) for t in range(4)])
SQUARE_BOX = [0.167, 0.147, 0.13, 0.13]


def save_trajectory(path, frames, score=1.0, **more):
    """A file as MAGICAL writes it, its class in a module that is gone when the file is read."""
    module = ModuleType("milbench.baselines.saved_trajectories")
    module.MILBenchTrajectory = namedtuple("MILBenchTrajectory", ("acts", "obs", "rews", "infos"))
    module.MILBenchTrajectory.__module__ = module.__name__
    names = ("milbench", "milbench.baselines", module.__name__)
    with pytest.MonkeyPatch.context() as patch:
        for name in names:
            patch.setitem(sys.modules, name, module if name == names[-1] else ModuleType(name))
        observations = [OrderedDict(allo=frame, ego=frame[:8, :8]) for frame in frames]
        trajectory = module.MILBenchTrajectory(
            np.zeros(len(frames), np.int64), observations, [0.0], [{"eval_score": 0}]
        )
        content = {"trajectory": trajectory, "score": score, "env_name": "MatchRegions-Demo-v0", **more}
        path.write_bytes(gzip.compress(pickle.dumps(content)))


def run(*arguments):
    cli.main(["import", *[str(argument) for argument in arguments]])


def refused(capsys, *arguments) -> str:
    """The one sentence that an import ends with; nothing may have been written."""
    out = Path(arguments[0]).parent / "refused.npz"
    with pytest.raises(SystemExit) as stop:
        run(*arguments, "--out", out)
    assert stop.value.code == 2 and not out.exists()
    printed = capsys.readouterr().err
    assert printed.count("error: ") == 1 and "Traceback" not in printed
    return printed.partition("error: ")[2]


def test_magicals_trajectories_come_through(tmp_path):
    save_trajectory(tmp_path / "demo-0.pkl.gz", FRAMES)
    save_trajectory(tmp_path / "demo-1.pkl.gz", FRAMES[:2], score=np.float64(0.5))
    run(tmp_path, "--out", tmp_path / "demos.npz", "--overlay", tmp_path / "overlay.mp4")
    demos = demonstration_files.load(tmp_path / "demos.npz")
    np.testing.assert_array_equal(demos.lengths, [4, 2])
    np.testing.assert_array_equal(demos.success, [True, False])
    assert demos.objects == OBJECTS and demos.task == "match_regions" and demos.frame_rate == 8.0
    star = demos.boxes[0, :, OBJECTS.names.index("star"), 0]
    np.testing.assert_allclose(np.diff(star), -0.1 / 2.04, atol=0.006)
    assert demos.mask[0, :, :7].all() and not demos.mask[..., 7].any()
    assert len(imageio.imread(tmp_path / "overlay.mp4", index=None)) == 4
    demos.save(tmp_path / "again.npz")
    again = demonstration_files.load(tmp_path / "again.npz")
    np.testing.assert_array_equal(again.boxes, demos.boxes)
    np.testing.assert_array_equal(again.mask, demos.mask)


class Malicious:
    def __init__(self, target):
        self.target = target

    def __reduce__(self):
        return os.mkdir, (str(self.target),)


def test_a_pickle_that_would_run_code_runs_none(tmp_path, capsys):
    (tmp_path / "bad.pkl.gz").write_bytes(gzip.compress(pickle.dumps(Malicious(tmp_path / "made"))))
    message = refused(capsys, tmp_path / "bad.pkl.gz")
    assert "bad.pkl.gz" in message and "posix.mkdir, which is not allowed" in message
    assert not (tmp_path / "made").exists()


@pytest.mark.parametrize("allowed", ["numpy.ndarray", "collections.OrderedDict"])
def test_attributes_of_what_is_allowed_are_not(allowed):
    module, name = allowed.split(".")
    with pytest.raises(pickle.UnpicklingError, match="not allowed"):
        magical._Unpickler(io.BytesIO()).find_class(module, f"{name}.__init__")


def test_damaged_and_foreign_files_are_refused(tmp_path, capsys, monkeypatch):
    path = tmp_path / "demo.pkl.gz"
    save_trajectory(path, FRAMES)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    assert "no trajectory of MAGICAL's" in refused(capsys, path)
    path.write_bytes(gzip.compress(pickle.dumps({"trajectory": [1, 2]})))
    assert "no field 'trajectory'" in refused(capsys, path)
    path.write_bytes(b"nothing of the kind")
    assert "no trajectory of MAGICAL's" in refused(capsys, path)
    save_trajectory(path, [])
    assert "obs is empty" in refused(capsys, path)
    save_trajectory(path, [FRAMES[0], FRAMES[1][:100]])
    assert "obs[1]['allo'] is no (H, W, 3) uint8 picture of the first one's size" in refused(capsys, path)
    save_trajectory(path, FRAMES, score="high")
    assert "score is of type str; allowed: a finite number" in refused(capsys, path)
    monkeypatch.setattr(magical, "MAX_BYTES", 1000)
    save_trajectory(path, FRAMES)
    assert "unpacked" in refused(capsys, path)


def test_frames_are_read_in_order_of_their_numbers(tmp_path):
    for number, frame in zip((0, 1, 2, 10), FRAMES, strict=True):
        imageio.imwrite(tmp_path / f"{number}.png", frame)
    run(tmp_path, "--out", tmp_path / "demos.npz")
    star = demonstration_files.load(tmp_path / "demos.npz").boxes[0, :, OBJECTS.names.index("star"), 0]
    assert np.all(np.diff(star) < 0)


def test_a_video_says_nearly_what_its_frames_say(tmp_path):
    write_video(FRAMES, tmp_path / "demo.mp4", 8.0)
    imageio.imwrite(tmp_path / "demo.gif", FRAMES, duration=125)
    for name in ("demo.mp4", "demo.gif"):
        (recording,) = Source(tmp_path / name).recordings(OBJECTS)
        assert recording.frames is not None and recording.frames.shape == FRAMES.shape
        assert np.abs(recording.frames.astype(int) - FRAMES).mean() < 3
        assert recording.frame_rate == pytest.approx(8.0, rel=0.05)  # a gif counts in hundredths


def test_what_is_wrong_with_pictures_is_said(tmp_path, capsys):
    folder = tmp_path / "demo"
    folder.mkdir()
    imageio.imwrite(folder / "0.png", FRAMES[0])
    imageio.imwrite(folder / "1.png", FRAMES[1][:100])
    assert "1.png: the frame is 384 x 100, but the folder's first one 384 x 384" in refused(capsys, folder)
    (folder / "1.png").write_bytes(b"no picture")
    assert "1.png: no picture that can be read" in refused(capsys, folder)
    (tmp_path / "demo.mp4").write_bytes(b"")
    assert "demo.mp4: no video that can be read" in refused(capsys, tmp_path / "demo.mp4")
    assert "is missing" in refused(capsys, tmp_path / "nowhere")
    assert "--frame-rate is 0.0; allowed: numbers above 0" in refused(capsys, folder, "--frame-rate", 0)
    (tmp_path / "empty").mkdir()
    assert "holds nothing of a known format" in refused(capsys, tmp_path / "empty")
    assert "holds no demonstrations" in refused(capsys, tmp_path / "empty", "--format", "video")
    assert "unknown format 'avi'" in refused(capsys, folder, "--format", "avi")
    imageio.imwrite(folder / "1.png", FRAMES[1])
    assert "pictures need a detector" in refused(capsys, folder, "--task", "shoes_in_box")


def write_labels(folder, lines):
    folder.mkdir(parents=True, exist_ok=True)
    for number, text in enumerate(lines):
        (folder / f"frame_{number}.txt").write_text(text)


def test_yolos_labels(tmp_path, capsys):
    boxes = " ".join(map(str, SQUARE_BOX))
    write_labels(tmp_path / "a", [f"3 {boxes}\n", f"3 {boxes} 0.9\n\n"])
    write_labels(tmp_path / "b", [f"3 {boxes}\n"])
    run(tmp_path, "--out", tmp_path / "demos.npz")
    demos = demonstration_files.load(tmp_path / "demos.npz")
    slot = OBJECTS.names.index("square")
    np.testing.assert_array_equal(demos.lengths, [2, 1])
    np.testing.assert_allclose(demos.boxes[0, :2, slot], [SQUARE_BOX] * 2)
    assert demos.mask[0, :2, slot].all() and demos.mask.sum() == 3
    write_labels(tmp_path / "b", [f"3 {boxes}\n9 {boxes}\n"])
    assert "frame_0.txt, line 2: class 9; allowed: 0 to 6" in refused(capsys, tmp_path)
    write_labels(tmp_path / "b", ["3 0.5 0.5 7 0.1"])
    assert "line 1: the box (cx, cy, w, h) is 0.5, 0.5, 7, 0.1; allowed: -0.5 to 1.5" in refused(capsys, tmp_path)
    write_labels(tmp_path / "b", ["3 0.5 0.5"])
    assert "line 1: 3 numbers; allowed: class cx cy w h" in refused(capsys, tmp_path)
    write_labels(tmp_path / "b", ["three 0.5"])
    assert "line 1: 'three 0.5' is not a list of numbers" in refused(capsys, tmp_path)


def test_frames_without_labels_are_frames_in_which_nothing_was_seen(tmp_path, capsys):
    boxes = " ".join(map(str, SQUARE_BOX))
    for number in (1, 2, 9):
        (tmp_path / f"{number:03d}.txt").write_text(f"3 {boxes}")
    run(tmp_path, "--out", tmp_path / "demos.npz")
    demos = demonstration_files.load(tmp_path / "demos.npz")
    np.testing.assert_array_equal(demos.mask[0, :, OBJECTS.names.index("square")], [1, 1, 0, 0, 0, 0, 0, 0, 1])
    (tmp_path / "100000.txt").write_text(f"3 {boxes}")
    (tmp_path / "demos.npz").unlink()
    assert "the files' numbers skip from 1 to 100000 in 4 files" in refused(capsys, tmp_path)


def test_nothing_seen_is_nothing_written(tmp_path, capsys):
    imageio.imwrite(tmp_path / "0.png", np.full((64, 64, 3), 128, np.uint8))
    assert "none of the objects goal_region" in refused(capsys, tmp_path)


def test_corner_files(tmp_path, capsys):
    write_labels(tmp_path / "a", ["0 0 0 0\n10 20 30 60\n"])
    (recording,) = Source(tmp_path, "corners", (100, 200)).recordings(OBJECTS)
    ((detection,),) = recording.detections
    assert detection.class_id == OBJECTS.class_ids[1]
    np.testing.assert_allclose(detection.box, [0.2, 0.2, 0.2, 0.2])
    assert "the size of the pictures is missing" in refused(capsys, tmp_path / "a", "--format", "corners")
    write_labels(tmp_path / "a", ["1 2 3 4\n" * 9])
    arguments = (tmp_path / "a", "--format", "corners", "--size", 100, 200)
    assert "line 9: more lines than the table's 8 objects" in refused(capsys, *arguments)


def test_cocos_json(tmp_path, capsys):
    content = {
        "categories": [{"id": 5, "name": "green_square"}],
        "images": [{"id": n, "file_name": f"video/{n}.png", "width": 200, "height": 100} for n in (10, 2)],
        "annotations": [{"image_id": n, "category_id": 5, "bbox": [20 + n, 10, 40, 20]} for n in (10, 2)],
    }
    path = tmp_path / "boxes.json"
    path.write_text(json.dumps(content))
    run(path, "--out", tmp_path / "demos.npz")
    demos = demonstration_files.load(tmp_path / "demos.npz")
    slot = OBJECTS.names.index("square")
    np.testing.assert_allclose(demos.boxes[0, :, slot, 0], [0.21, 0.25])  # frame 2 comes before frame 10
    np.testing.assert_allclose(demos.boxes[0, :, slot, 1:], [[0.2, 0.2, 0.2]] * 2)
    content["categories"][0]["name"] = "cat"
    path.write_text(json.dumps(content))
    assert "annotations[0]: category 'cat'; allowed: goal_region" in refused(capsys, path)
    path.write_text("{}")
    assert "not COCO's JSON" in refused(capsys, path)


def test_formats_are_told_by_names(tmp_path):
    for name, expected in (("a.pkl.gz", "magical"), ("a.GIF", "video"), ("a.jpg", "frames"), ("a.txt", "yolo")):
        folder = tmp_path / expected
        folder.mkdir()
        (folder / name).touch()
        assert guess_format(folder) == guess_format(folder / name) == expected
    with pytest.raises(ImportFailure, match="known formats"):
        guess_format(tmp_path / "nothing")


@pytest.mark.skipif(not REAL.exists(), reason="the human demonstrations are not here")
def test_real_human_demonstrations(tmp_path):
    run(REAL / "demo-MatchRegions-Demo-v0-000.pkl.gz", "--out", tmp_path / "human.npz")
    demos = demonstration_files.load(tmp_path / "human.npz")
    assert demos.mask[0, :, :7].all() and demos.success.all() and demos.num_frames == 121
    with np.load(REAL / "truth.npz") as truth:
        true = truth["boxes"][0][:, [5, 6, 0, 1, 2, 3, 4]]
    corners = np.concatenate([demos.boxes[0, :, :7, :2] - demos.boxes[0, :, :7, 2:] / 2,
                              demos.boxes[0, :, :7, :2] + demos.boxes[0, :, :7, 2:] / 2], -1)  # fmt: skip
    assert np.abs(corners - true).mean() < 1.0 / 384 and np.abs(corners - true).max() < 8 / 384


FORGED = """
import sys
from pathlib import Path
from graphrl_jax.importers.magical import load_trajectory
from graphrl_jax.importers.recording import ImportFailure
try:
    load_trajectory(Path(sys.argv[1]))
except ImportFailure as failure:
    print(failure)
"""


def forged_pickles():
    """Pickles that would let numpy point anywhere, or fill the memory, were it numpy that built them."""
    dtype = b"cnumpy\ndtype\n(X\x02\x00\x00\x00%bI00\nI01\ntR"
    state = b"(I3\nX\x01\x00\x00\x00|NNNI-1\nI-1\nI0\ntb"
    scalar = b"cnumpy.core.multiarray\nscalar\n(%bC\x08AAAAAAAAtR."
    yield "object flags cleared", b"\x80\x04" + scalar % (dtype % b"O8" + state)
    yield "objects", b"\x80\x04" + scalar % (dtype % b"O8")
    yield "array itself", b"\x80\x04cnumpy\nndarray\n((I100000000\ntX\x01\x00\x00\x00OtR."
    yield "more than its bytes", (
        b"\x80\x04cnumpy.core.multiarray\n_reconstruct\n(cnumpy\nndarray\n(I0\ntC\x01btR(I1\n(I100000000\nt"
        + dtype % b"u1" + b"I00\nC\x01Atb."
    )  # fmt: skip
    yield "far memo", b"\x80\x04Nr" + (0xFFFFFFF0).to_bytes(4, "little") + b"."
    yield "byte array", b"\x80\x05\x96" + (1 << 40).to_bytes(8, "little") + b"."
    yield (
        "class changed",
        (b"\x80\x04cmilbench.baselines.saved_trajectories\nMILBenchTrajectory\n(N}X\x03\x00\x00\x00obsK\x01stb."),
    )
    yield "instance changed", b"\x80\x04ccollections\nOrderedDict\n)R}X\x03\x00\x00\x00getK\x05sb."


@pytest.mark.parametrize("name, raw", forged_pickles())
def test_forged_pickles_are_refused_by_a_process_that_lives_on(tmp_path, name, raw):
    path = tmp_path / "forged.pkl.gz"
    path.write_bytes(gzip.compress(raw))
    done = subprocess.run(
        [sys.executable, "-c", FORGED, str(path)], capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 0 and "forged.pkl.gz: " in done.stdout, (name, done.stdout, done.stderr[-300:])


def test_frames_counted_many_times_are_not_piled_up(tmp_path, monkeypatch):
    monkeypatch.setattr(magical, "MAX_BYTES", 10 * FRAMES[0].nbytes)
    save_trajectory(tmp_path / "demo.pkl.gz", [FRAMES[0]] * 50)
    with pytest.raises(ImportFailure, match="50 frames are more than"):
        list(magical.read_trajectories([tmp_path / "demo.pkl.gz"]))
