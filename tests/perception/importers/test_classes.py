"""Classes of exports: one name each, in order, or one sentence."""

import json

import pytest

from graphrl_jax.perception.importers.classes import read_classes
from graphrl_jax.perception.importers.recording import ImportFailure

CATEGORIES = [{"id": 7, "name": "hand"}, {"id": 2, "name": "red cup"}]
COCO = json.dumps({"images": [], "annotations": [], "categories": CATEGORIES})
FILES = {
    "data.yaml": "train: images\nnc: 2\nnames: [hand, red cup]\n",
    "dataset.yaml": "names:\n  1: red cup\n  0: hand\n",
    "classes.txt": "hand\nred cup\n",
    "obj.names": "hand\r\nred cup\r\n",
    "instances.json": COCO,
}


@pytest.mark.parametrize("name", FILES)
def test_the_classes_of_an_export_are_read_from_its_file_and_from_its_folder(tmp_path, name):
    (tmp_path / name).write_text(FILES[name])
    assert read_classes(tmp_path / name) == read_classes(tmp_path) == ["hand", "red cup"]


def test_cocos_files_may_lie_deeper_and_must_agree(tmp_path):
    for part in ("train", "valid"):
        (tmp_path / part).mkdir()
        (tmp_path / part / "_annotations.coco.json").write_text(COCO)
    (tmp_path / "notes.json").write_text("[]")
    assert read_classes(tmp_path) == ["hand", "red cup"]
    (tmp_path / "valid" / "_annotations.coco.json").write_text(COCO.replace("hand", "arm"))
    with pytest.raises(ImportFailure, match=r"train/_ann\S+ and \S+valid/_ann\S+ differ in their categories"):
        read_classes(tmp_path)


def test_a_name_of_two_classes_is_one(tmp_path):
    (tmp_path / "data.yaml").write_text("names: [cup, hand, cup]")
    assert read_classes(tmp_path) == ["cup", "hand"]


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("data.yaml", "nc: 2\n", "data.yaml names no classes; allowed: a .yaml file with names, classes.txt"),
        ("data.yaml", "names: 3\n", "data.yaml names no classes"),
        ("data.yaml", "names: {a: cup}\n", "data.yaml: names is {'a': 'cup'}; allowed: a list of names"),
        ("data.yaml", "names: [cup, '']\n", "data.yaml: the name of class 1 is ''; allowed: a text"),
        ("data.yaml", "names: [cup", "data.yaml: no YAML"),
        ("classes.txt", "", "classes.txt names no classes"),
        ("classes.txt", "cup\n\nhand\n", "classes.txt: the name of class 1 is ''; allowed: a text"),
        ("frame_1.txt", "0 0.5 0.5 0.1 0.1\n", "frame_1.txt names no classes"),
        ("boxes.json", "{", "boxes.json: no JSON"),
        ("boxes.json", "[]", "boxes.json is of type list; allowed: a JSON object"),
        ("boxes.json", "{}", "boxes.json: not COCO's JSON: categories is of type NoneType; allowed: a list"),
        ("boxes.json", '{"categories": []}', "boxes.json names no classes"),
        ("boxes.json", '{"categories": [{"id": 1}]}', r"boxes.json: categories\[0\]: name is None; allowed: a text"),
        ("boxes.json", '{"categories": ["cup"]}', r"boxes.json: categories\[0\]: name is None"),
    ],
)
def test_what_names_no_classes_is_one_sentence(tmp_path, name, text, message):
    (tmp_path / name).write_text(text)
    with pytest.raises(ImportFailure, match=message):
        read_classes(tmp_path / name)


def test_a_path_without_an_export_is_one_sentence(tmp_path):
    with pytest.raises(ImportFailure, match="none.yaml is missing"):
        read_classes(tmp_path / "none.yaml")
    with pytest.raises(ImportFailure, match=f"^{tmp_path} names no classes; allowed: a .yaml file"):
        read_classes(tmp_path)
