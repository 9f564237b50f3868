"""Files of objects: what they say, and what is wrong with them by file and field."""

import numpy as np
import pytest

from graphrl_jax.perception.objects_file import ObjectsError, read_objects, template

DRAWER = """
name = "drawer"
frame_rate = 10

[[objects]]
name = "gripper"
kind = "robot"
label = "hand"

[[objects]]
name = "drawer"
kind = "articulated"

[[objects]]
name = "left cup"
label = "cup"

[[objects]]
name = "right cup"
label = "cup"

[[objects]]
name = "shelf"
kind = "fixture"
"""


@pytest.fixture
def read(tmp_path):
    def read(text: str):
        (tmp_path / "drawer.toml").write_text(text)
        return read_objects(tmp_path / "drawer.toml")

    return read


def test_a_file_says_what_the_objects_are(read):
    found = read(DRAWER)
    objects = found.objects
    assert (found.name, found.frame_rate, found.detector()) == ("drawer", 10.0, None)
    assert objects.names == ("gripper", "drawer", "left cup", "right cup", "shelf")
    assert objects.class_names == ("hand", "drawer", "cup", "shelf") and objects.class_ids == (0, 1, 2, 2, 3)
    assert objects.is_robot == (True, False, False, False, False)
    assert objects.is_articulated == (False, True, False, False, False)
    assert objects.is_fixture == (False, False, False, False, True)


def test_objects_are_found_by_their_colours(read):
    coloured = read(
        'name = "cups"\nframe_rate = 8.5\n'
        '[[objects]]\nname = "red cup"\ncolour = [220, 40, 40]\n[[objects]]\nname = "hand"\ncolour = [40, 40, 220]\n'
    )
    frame = np.full((40, 80, 3), 255, np.uint8)
    frame[10:20, 20:40] = (214, 50, 36)
    frame[20:40, 60:70] = (40, 40, 220)
    found = {one.class_id: one.box for one in coloured.detector().detect(frame)}
    np.testing.assert_allclose(found[0], [0.375, 0.375, 0.25, 0.25], atol=1e-6)
    np.testing.assert_allclose(found[1], [0.8125, 0.75, 0.125, 0.5], atol=1e-6)


RED = "colour = [220, 40, 40]\n"


@pytest.mark.parametrize(
    "change, message",
    [
        (('name = "drawer"\nframe', "frame"), "drawer.toml: name is None; allowed: a text"),
        (("frame_rate = 10", "frame_rate = 0"), "frame_rate is 0; allowed: a number above 0"),
        (("frame_rate = 10", ""), "frame_rate is None; allowed: a number above 0"),
        (("frame_rate = 10", "fps = 10"), "drawer.toml: fps is unknown; known fields: name, frame_rate, objects"),
        (
            ('kind = "robot"', 'kind = "arm"'),
            r"object 1 \(gripper\): kind is 'arm'; allowed: robot, fixture, articulated, free",
        ),
        (('label = "hand"', "label = 3"), r"object 1 \(gripper\): label is 3; allowed: a text"),
        (
            ('label = "hand"', 'class = "hand"'),
            r"object 1 \(gripper\): class is unknown; known fields: name, kind, label",
        ),
        (('name = "drawer"\nkind', "kind"), "drawer.toml: object 2: name is None; allowed: a text"),
        (
            ('kind = "fixture"', RED.replace("colour", "color")),
            r"\(shelf\): color is unknown \(did you mean colour\?\); known",
        ),
        (('"right cup"', '"left cup"'), "names must hold at least one name and no name twice"),
        (('kind = "fixture"', "colour = [1, 2]"), r"object 5 \(shelf\): colour is \[1, 2\]; allowed: red, green, blue"),
        (('kind = "fixture"', RED), "no object labelled 'hand' has a colour; allowed: all or none"),
        (("[[objects]]", "[objects]"), "drawer.toml(: objects is| is not valid TOML:) "),
        (("frame_rate", "frame rate"), "drawer.toml is not valid TOML: "),
    ],
)
def test_what_is_wrong_is_named_by_file_and_field(read, change, message):
    with pytest.raises(ObjectsError, match=message):
        read(DRAWER.replace(*change))


def test_colours_tell_objects_apart(read):
    start = f'name = "a"\nframe_rate = 8\n[[objects]]\nname = "b"\n{RED}[[objects]]\nname = "c"\n{RED}'
    with pytest.raises(ObjectsError, match="two labels have the same colour"):
        read(start)
    with pytest.raises(ObjectsError, match="two objects are labelled 'b'; allowed with colours: one"):
        read(start + 'label = "b"\n')


def test_a_missing_file_is_one_sentence(tmp_path):
    with pytest.raises(ObjectsError, match="none.toml is missing"):
        read_objects(tmp_path / "none.toml")
    with pytest.raises(ObjectsError, match="cannot be read: Is a directory"):
        read_objects(tmp_path)


@pytest.mark.parametrize("labels", [[], ["cup", 'a "big" \\ box', "two\nlines", "über \x7f"]])
def test_a_template_can_be_read(read, labels):
    found = read(template('a "drawer"', labels))
    assert found.detector() is None
    assert found.name == 'a "drawer"' and found.objects.class_names == tuple(labels or ("gripper", "shelf", "cup"))


def test_a_template_says_what_may_be_filled_in_and_can_be(read):
    text = template("cups", ["hand", "cup"])
    assert text.count('kind = "free"  # robot, fixture, articulated or free\n# colour = [red, green, blue]\n') == 2
    for colour in ("[40, 40, 220]", "[220, 40, 40]"):
        text = text.replace("# colour = [red, green, blue]", f"colour = {colour}", 1)
    assert read(text).detector() is not None
