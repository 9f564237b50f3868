"""`graphrl import` as a command; what it reads is tested with the readers."""

import warnings

from tests.helpers.importing import FRAMES, run, save_trajectory


def test_the_overlay_is_written_without_a_warning_of_the_fork_that_starts_ffmpeg(tmp_path):
    save_trajectory(tmp_path / "a.pkl.gz", FRAMES)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        run(tmp_path, "--out", tmp_path / "demos.npz", "--overlay", tmp_path / "seen.mp4")
    assert (tmp_path / "seen.mp4").exists()
    assert not [one for one in caught if "os.fork()" in str(one.message)]
