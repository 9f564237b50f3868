"""MAGICAL's files are read as they are; what is damaged or foreign is one sentence, and nothing is run or written."""

import gzip
import io
import os
import pickle
import subprocess
import sys
from pathlib import Path

import imageio.v3 as imageio
import numpy as np
import pytest

from graphrl_jax.demonstrations import load
from graphrl_jax.perception.importers import magical
from graphrl_jax.perception.importers.recording import ImportFailure
from tasks.match_regions.objects import OBJECTS
from tests.helpers.importing import FRAMES, refused, run, save_trajectory

REAL = Path(__file__).parents[4] / "shared" / "data" / "magical_match_regions"


def test_magicals_trajectories_come_through(tmp_path):
    save_trajectory(tmp_path / "demo-0.pkl.gz", FRAMES)
    save_trajectory(tmp_path / "demo-1.pkl.gz", FRAMES[:2], score=np.float64(0.5))
    run(tmp_path, "--out", tmp_path / "demos.npz", "--overlay", tmp_path / "overlay.mp4")
    demos = load(tmp_path / "demos.npz")
    np.testing.assert_array_equal(demos.lengths, [4, 2])
    np.testing.assert_array_equal(demos.success, [True, False])
    assert demos.objects == OBJECTS and demos.task == "match_regions" and demos.frame_rate == 8.0
    star = demos.boxes[0, :, OBJECTS.names.index("star"), 0]
    np.testing.assert_allclose(np.diff(star), -0.1 / 2.04, atol=0.006)
    assert demos.mask[0, :, :7].all() and not demos.mask[..., 7].any()
    assert len(imageio.imread(tmp_path / "overlay.mp4", index=None)) == 4
    demos.save(tmp_path / "again.npz")
    again = load(tmp_path / "again.npz")
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
    assert "obs[1]['allo'] is no (H, W, 3) uint8 image of the first one's size" in refused(capsys, path)
    save_trajectory(path, FRAMES, score="high")
    assert "score is of type str; allowed: a finite number" in refused(capsys, path)
    monkeypatch.setattr(magical, "MAX_BYTES", 1000)
    save_trajectory(path, FRAMES)
    assert "unpacked" in refused(capsys, path)


@pytest.mark.skipif(not REAL.exists(), reason="the human demonstrations are not here")
def test_real_human_demonstrations(tmp_path):
    run(REAL / "demo-MatchRegions-Demo-v0-000.pkl.gz", "--out", tmp_path / "human.npz")
    demos = load(tmp_path / "human.npz")
    assert demos.mask[0, :, :7].all() and demos.success.all() and demos.num_frames == 121
    with np.load(REAL / "truth.npz") as truth:
        true = truth["boxes"][0][:, [5, 6, 0, 1, 2, 3, 4]]
    corners = np.concatenate([demos.boxes[0, :, :7, :2] - demos.boxes[0, :, :7, 2:] / 2,
                              demos.boxes[0, :, :7, :2] + demos.boxes[0, :, :7, 2:] / 2], -1)  # fmt: skip
    assert np.abs(corners - true).mean() < 1.0 / 384 and np.abs(corners - true).max() < 8 / 384


FORGED = """
import sys
from pathlib import Path
from graphrl_jax.perception.importers.magical import load_trajectory
from graphrl_jax.perception.importers.recording import ImportFailure
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


@pytest.mark.parametrize("name, raw", list(forged_pickles()))
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
