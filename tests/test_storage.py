"""Files are whole or not there, and a pytree comes back leaf by leaf under its own name or not at all."""

from pathlib import Path
from typing import Any

import jax
import numpy as np
import pytest

from graphrl_jax.optimizer import AdamState
from graphrl_jax.storage import (
    VERSION,
    StorageError,
    has_generation,
    is_key,
    load_generation,
    load_tree,
    read_json,
    save_generation,
    save_tree,
    write_arrays,
    write_atomically,
    write_json,
)

TREE = {
    "params": {"head": ({"weight": np.arange(6, dtype=np.float32).reshape(2, 3)}, {"bias": np.zeros(3, np.float32)})},
    "state": AdamState(step=np.int32(7), mu=np.ones(2, np.float32), nu=np.full(2, 0.25, np.float32)),
    "keys": jax.random.split(jax.random.key(3), 2),
    "flag": np.array(True),
}
HEAD = "tree/params/head/0/weight"


@pytest.fixture
def path(tmp_path: Path) -> Path:
    save_tree(tmp_path / "run" / "tree.npz", TREE)
    return tmp_path / "run" / "tree.npz"


def entries(path: Path) -> dict[str, np.ndarray]:
    with np.load(path) as file:
        return dict(file)


def plain(leaf: Any) -> np.ndarray:
    """A leaf as numbers, typed keys as what they are made of."""
    return np.asarray(jax.random.key_data(leaf) if is_key(leaf) else leaf)


def assert_same(loaded: Any, expected: Any) -> None:
    assert jax.tree.structure(loaded) == jax.tree.structure(expected)
    for one, other in zip(jax.tree.leaves(loaded), jax.tree.leaves(expected), strict=True):
        assert one.dtype == other.dtype
        np.testing.assert_array_equal(plain(one), plain(other))


def refused(path: Path, like: Any = TREE) -> str:
    """The one sentence that names the file."""
    with pytest.raises(StorageError) as caught:
        load_tree(path, like)
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)
    return str(caught.value)


def test_a_tree_comes_back_whole_into_arrays_or_shapes(path):
    assert_same(load_tree(path, TREE), TREE)
    shapes = jax.eval_shape(lambda: jax.tree.map(jax.numpy.asarray, TREE))
    loaded = load_tree(path, shapes)
    assert_same(loaded, TREE)
    drawn = jax.random.uniform(loaded["keys"][1])
    assert float(drawn) == float(jax.random.uniform(TREE["keys"][1]))


def test_a_leaf_is_named_by_its_path_through_the_tree(path):
    assert list(path.parent.iterdir()) == [path]
    assert set(entries(path)) == {
        "version", HEAD, "tree/params/head/1/bias", "tree/state/step", "tree/state/mu", "tree/state/nu", "tree/keys",
        "tree/flag",
    }  # fmt: skip


def test_a_single_leaf_is_a_tree(tmp_path):
    leaf = np.arange(3, dtype=np.int32)
    save_tree(tmp_path / "leaf.npz", leaf)
    np.testing.assert_array_equal(load_tree(tmp_path / "leaf.npz", leaf), leaf)
    assert set(entries(tmp_path / "leaf.npz")) == {"version", "tree"}


def test_names_decide_and_not_the_order(path):
    write_arrays(path, dict(reversed(entries(path).items())))
    assert_same(load_tree(path, TREE), TREE)


def test_missing_unknown_and_renamed_leaves_are_named(path):
    whole = entries(path)
    rest = {name: array for name, array in whole.items() if name != HEAD}
    write_arrays(path, rest)
    assert f"lacks {HEAD}" in refused(path)
    write_arrays(path, {**whole, "tree/extra": np.zeros(1)})
    assert "holds tree/extra" in refused(path)
    write_arrays(path, {**rest, "tree/params/head/0/weights": whole[HEAD]})
    message = refused(path)
    assert f"lacks {HEAD}" in message or "holds tree/params/head/0/weights" in message


def test_permuted_leaves_are_named(path):
    whole = entries(path)
    write_arrays(path, {**whole, HEAD: whole["tree/params/head/1/bias"], "tree/params/head/1/bias": whole[HEAD]})
    assert f"{HEAD} is float32[3], but this program needs float32[2, 3]" in refused(path)


@pytest.mark.parametrize(
    ("name", "array", "says"),
    [
        (HEAD, np.zeros((3, 2), np.float32), "is float32[3, 2], but this program needs float32[2, 3]"),
        (HEAD, np.zeros((2, 3), np.float64), "is float64[2, 3], but this program needs float32[2, 3]"),
        ("tree/state/step", np.float32(7), "is float32[], but this program needs int32[]"),
        ("tree/keys", np.zeros((2, 3), np.uint32), "is uint32[2, 3], but this program needs uint32[2, 2]"),
    ],
)
def test_a_wrong_shape_or_dtype_names_the_leaf(path, name, array, says):
    write_arrays(path, {**entries(path), name: array})
    assert f"{name} {says}" in refused(path)


def test_keys_are_not_taken_for_numbers_nor_numbers_for_keys(path):
    numbers = {**TREE, "keys": np.zeros((2, 2), np.float32)}
    assert "tree/keys is uint32[2, 2], but this program needs float32[2, 2]" in refused(path, numbers)
    keys = {**TREE, "flag": jax.random.key(0)}
    assert "tree/flag is bool[], but this program needs uint32[2]" in refused(path, keys)
    assert is_key(TREE["keys"]) and not is_key(TREE["flag"])


@pytest.mark.parametrize("version", [1, 3, np.array([VERSION]), None])
def test_another_version_is_refused(path, version):
    whole = {name: array for name, array in entries(path).items() if name != "version"}
    write_arrays(path, whole if version is None else {**whole, "version": np.asarray(version)})
    assert f"has format version {version}; this release reads version {VERSION} only" in refused(path)


@pytest.mark.parametrize("kept", [0.0, 0.1, 0.5, 0.99])
def test_a_truncated_file_is_named(path, kept):
    content = path.read_bytes()
    path.write_bytes(content[: int(kept * len(content))])
    assert "damaged or no checkpoint" in refused(path)


def test_a_missing_file_a_folder_and_another_format_are_named(path):
    assert "is missing" in refused(path.with_name("nowhere.npz"))
    refused(path.parent)
    path.write_text("no archive")
    assert "damaged or no checkpoint" in refused(path)


def test_objects_are_not_unpickled(path):
    write_arrays(path, {**entries(path), HEAD: np.array({"a": 1}, object)})
    assert "damaged or no checkpoint" in refused(path)


def test_a_failing_write_leaves_the_old_file_and_no_temporary_one(tmp_path):
    path = tmp_path / "new folder" / "file.txt"
    write_atomically(path, lambda temporary: temporary.write_text("old"))

    def fails(temporary: Path) -> None:
        temporary.write_text("half")
        raise OSError("disk full")

    with pytest.raises(OSError, match="disk full"):
        write_atomically(path, fails)
    assert path.read_text() == "old" and list(path.parent.iterdir()) == [path]
    with pytest.raises(TypeError):
        write_json(path, {"a": object()})
    assert path.read_text() == "old" and list(path.parent.iterdir()) == [path]


def test_a_file_that_may_not_be_written_is_named_itself(tmp_path):
    def refused(temporary: Path) -> None:
        raise PermissionError(13, "Permission denied", str(temporary))

    with pytest.raises(PermissionError) as error:
        write_atomically(tmp_path / "out.npz", refused)
    assert str(error.value) == f"[Errno 13] Permission denied: '{tmp_path / 'out.npz'}'"


def test_arrays_are_written_at_exactly_the_path(tmp_path):
    write_arrays(tmp_path / "arrays", {"a": np.arange(3)})
    assert list(tmp_path.iterdir()) == [tmp_path / "arrays"]
    np.testing.assert_array_equal(entries(tmp_path / "arrays")["a"], np.arange(3))


def test_json_comes_back_and_what_cannot_be_read_is_named(tmp_path):
    path = tmp_path / "config.json"
    with pytest.raises(StorageError, match="config.json is missing: .* holds no run"):
        read_json(path)
    write_json(path, {"a": [1, 2.5, None, "é"]})
    assert read_json(path) == {"a": [1, 2.5, None, "é"]} and path.read_text().endswith("}\n")
    for content in (b'{"a": [1,', b"\xff\xfe\x00"):
        path.write_bytes(content)
        with pytest.raises(StorageError, match="config.json cannot be read as JSON"):
            read_json(path)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_tree_that_is_not_finite_is_never_written(path, bad):
    before = path.read_bytes()
    spoiled = {**TREE, "params": {"head": ({"weight": np.full((2, 3), bad, np.float32)}, {"bias": np.zeros(3)})}}
    with pytest.raises(StorageError, match=f"tree.npz is not written, because {HEAD} is not finite"):
        save_tree(path, spoiled)
    with pytest.raises(StorageError, match="is not finite"):
        save_generation(path, spoiled)
    assert path.read_bytes() == before and list(path.parent.iterdir()) == [path]


def counted(number: int) -> dict[str, np.ndarray]:
    return {"number": np.int32(number)}


def test_the_last_two_generations_are_kept(tmp_path):
    path = tmp_path / "state.npz"
    assert not has_generation(path)
    for number in range(3):
        save_generation(path, counted(number))
        assert has_generation(path)
    assert sorted(one.name for one in tmp_path.iterdir()) == ["state.npz", "state.previous.npz"]
    loaded, lost = load_generation(path, counted(0))
    assert loaded["number"] == 2 and lost is None


@pytest.mark.parametrize("damage", ["torn", "missing"])
def test_a_torn_newest_generation_falls_back_to_the_one_before_and_says_so(tmp_path, damage):
    path = tmp_path / "state.npz"
    for number in range(2):
        save_generation(path, counted(number))
    if damage == "torn":
        path.write_bytes(path.read_bytes()[:100])
    else:
        path.unlink()
    assert has_generation(path)
    loaded, lost = load_generation(path, counted(0))
    assert loaded["number"] == 0
    assert (
        lost is not None and "state.npz is " in lost and lost.endswith(f"going on from {tmp_path}/state.previous.npz")
    )


def test_generations_of_another_program_are_an_error_about_the_newest(tmp_path):
    path = tmp_path / "state.npz"
    for number in range(2):
        save_generation(path, counted(number))
    with pytest.raises(StorageError, match="state.npz lacks tree/other"):
        load_generation(path, {"other": np.int32(0)})


def test_json_knows_no_nan(tmp_path):
    value = {"a": [1.0, float("nan"), {"b": float("-inf")}], "c": (2, None, "NaN")}
    write_json(tmp_path / "value.json", value)
    assert read_json(tmp_path / "value.json") == {"a": [1.0, None, {"b": None}], "c": [2, None, "NaN"]}
