"""Files and folders come in order of the numbers in their names."""

from pathlib import Path

from graphrl_jax.perception.importers.recording import files_of, folders_of, in_order


def test_numbers_count_as_numbers():
    names = ["run10/2.png", "run2/10.png", "run2/9.png", "a.png"]
    ordered = ["a.png", "run2/9.png", "run2/10.png", "run10/2.png"]
    assert in_order(map(Path, names)) == [Path(name) for name in ordered]
    folders = folders_of([Path(name) for name in ordered])
    assert list(folders) == [Path("."), Path("run2"), Path("run10")]
    assert folders[Path("run2")] == [Path("run2/9.png"), Path("run2/10.png")]


def test_files_are_found_at_any_depth_by_their_endings(tmp_path):
    (tmp_path / "deep" / "er").mkdir(parents=True)
    for name in ("2.PNG", "deep/1.png", "deep/er/10.jpg", "notes.txt"):
        (tmp_path / name).touch()
    found = files_of(tmp_path, ".png", ".jpg")
    assert found == [tmp_path / "2.PNG", tmp_path / "deep/1.png", tmp_path / "deep/er/10.jpg"]
    assert files_of(tmp_path / "2.PNG", ".png") == [tmp_path / "2.PNG"]
    assert files_of(tmp_path / "notes.txt", ".png") == []
