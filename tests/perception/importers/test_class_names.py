"""Class names that come with labels decide what their numbers mean."""

import pytest

from graphrl_jax.perception.importers.class_names import (
    class_id,
    class_named,
    class_names_of,
    lines_of_names,
    numbered_names,
)
from graphrl_jax.perception.importers.recording import ImportFailure

NAMES = {0: "green_square", 1: "no"}
FILES = {
    "data.yaml": "nc: 2\nnames: ['green_square', 'no']\n",
    "dataset.yml": "names:\n- green_square  # first\n- no\n",
    "coco8.yaml": "path: .\nnames:\n  0: green_square\n  1: no\n",
    "flow.yaml": "names: {0: green_square, 1: no}\n",
    "classes.txt": "green_square\r\nno\r\n\r\n",
    "Classes.txt": "\ufeffgreen_square\nno",
    "obj.names": "green_square\nno\n",
    "_darknet.labels": "green_square\nno",
}


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("place", ["", "labels", "labels/train"])
def test_names_lie_beside_labels_or_above(tmp_path, name, place):
    folder = tmp_path / "set" / "labels" / "train"
    folder.mkdir(parents=True)
    path = tmp_path / "set" / place / name
    path.write_text(FILES[name], "utf-8")
    for source in (tmp_path / "set", folder.parent, folder, folder / "0.txt"):
        assert class_names_of(folder, source) == (path, NAMES)


def test_names_outside_the_data_set_do_not_count(tmp_path):
    folder = tmp_path / "in" / "demo"
    folder.mkdir(parents=True)
    (tmp_path / "classes.txt").write_text("cat\n")
    (tmp_path / "in" / "other.yaml").write_text("lr: 0.1\n")
    assert class_names_of(folder, tmp_path / "in") is None
    (tmp_path / "in" / "classes.txt").write_text("a\n\nb\n")
    assert class_names_of(folder, tmp_path / "in")[1] == {0: "a", 1: "", 2: "b"}
    (folder / "classes.txt").write_text("b\n")
    assert class_names_of(folder, tmp_path / "in")[1] == {0: "b"}


@pytest.mark.parametrize(
    "files, message",
    [
        ({"classes.txt": "a\n", "data.yaml": "names: [b]\n"}, "differ in their class names"),
        ({"data.yaml": "names: [[a, b]]\n"}, r"data.yaml: names is \[\['a', 'b'\]\]"),
        ({"data.yaml": "names: []\n"}, r"data.yaml: names is \[\]"),
        ({"data.yaml": "names: {x: a}\n"}, "data.yaml: names is {'x': 'a'}"),
        ({"data.yaml": "names: [a\n"}, "data.yaml: no YAML"),
    ],
)
def test_names_that_cannot_be_read_are_one_sentence(tmp_path, files, message):
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    with pytest.raises(ImportFailure, match=message) as failure:
        class_names_of(tmp_path, tmp_path)
    assert "\n" not in str(failure.value)


def test_a_number_means_the_class_of_its_name(tmp_path):
    table = ("goal_region", "green_square")
    assert class_id(1, None, table, "line 1") == 1
    assert class_id(0, (tmp_path, NAMES), table, "line 1") == 1
    for number, named, message in (
        (2, None, "line 1: class 2; allowed: 0 to 1"),
        (2, (tmp_path, NAMES), "line 1: class 2; allowed: 0, 1, named by "),
        (1, (tmp_path, NAMES), "line 1: class 1 is 'no' by .*; allowed: goal_region, green_square"),
    ):
        with pytest.raises(ImportFailure, match=message):
            class_id(number, named, table, "line 1")


@pytest.mark.parametrize("name", ["labels.txt", "Classes.TXT", "obj.names"])
def test_lines_of_names_count_from_1(tmp_path, name):
    (tmp_path / "gt").mkdir()
    (tmp_path / "gt" / "data.yaml").write_text("names: [cat]")
    assert lines_of_names(tmp_path / "gt", tmp_path) is None
    (tmp_path / name).write_text("robot\r\n\r\nstar\r\n", "utf-8-sig")
    assert lines_of_names(tmp_path / "gt", tmp_path) == (tmp_path / name, {1: "robot", 2: "", 3: "star"})
    assert lines_of_names(tmp_path / "gt", tmp_path / "gt") is None


def test_classes_of_the_table_by_name_and_by_number_from_1():
    table = ("goal_region", "green_square")
    assert class_named("green_square", table, "image 1: label") == 1
    assert class_id(2, numbered_names(table), table, "line 1") == 1
    with pytest.raises(ImportFailure, match="image 1: label 'cat'; allowed: goal_region, green_square"):
        class_named("cat", table, "image 1: label")
    for name in (None, 1, ["robot"]):
        with pytest.raises(ImportFailure, match="allowed: goal_region, green_square"):
            class_named(name, table, "image 1: label")
    for number in (0, 3):
        with pytest.raises(ImportFailure, match=f"line 1: class {number}; allowed: 1, 2, named by the object table"):
            class_id(number, numbered_names(table), table, "line 1")
