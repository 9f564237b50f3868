"""Masks: a box goes around the pixels of a value, which says its object; what is no mask is one sentence."""

import numpy as np
import pytest
from PIL import Image

from graphrl_jax.demonstrations import load
from graphrl_jax.perception.importers.masks import first_mask, mask_files, read_masks, without_masks
from graphrl_jax.perception.importers.recording import ImportFailure
from tasks.match_regions.objects import OBJECTS
from tests.helpers.importing import FRAMES, refused, run

SQUARE, STAR = (OBJECTS.class_names.index(name) for name in ("green_square", "green_star"))


def mask(objects, shape=(20, 10)):
    """Values (H, W); `objects` are the first and last row and column of each value, both inside."""
    values = np.zeros(shape, np.uint8)
    for value, (top, left, bottom, right) in objects.items():
        values[top : bottom + 1, left : right + 1] = value
    return values


def save(path, values, mode="P"):
    """A PNG with a palette whose colours are not the values, or a grey one."""
    path.parent.mkdir(parents=True, exist_ok=True)
    image = Image.fromarray(values)
    if mode == "P":
        image.putpalette([(7 * number + 3) % 256 for number in range(768)])
    (image if mode == "P" else image.convert(mode)).save(path)


@pytest.fixture
def read(tmp_path):
    """The recordings of a folder: class and box of the detections in each frame."""

    def read(folder=tmp_path):
        recordings = read_masks(sorted(folder.rglob("*.png")), folder, OBJECTS)
        return [
            [[(one.class_id, [round(float(value), 4) for value in one.box]) for one in frame] for frame in r.detections]
            for r in recordings
        ]

    return read


def test_masks_of_a_video(tmp_path):
    """As DAVIS has them: pictures and masks in folders of their own."""
    for number, left in enumerate((1, 2, 3)):
        save(tmp_path / f"Annotations/480p/pick/{number:05d}.PNG", mask({4: (2, left, 5, left + 1)}))
        path = tmp_path / f"JPEGImages/480p/pick/{number:05d}.jpg"
        path.parent.mkdir(parents=True, exist_ok=True)
        Image.fromarray(FRAMES[0]).save(path)
    run(tmp_path, "--out", tmp_path / "demos.npz")
    demos = load(tmp_path / "demos.npz")
    boxes = demos.boxes[0, :, OBJECTS.names.index("square")]
    np.testing.assert_allclose(boxes, [[x, 0.2, 0.2, 0.2] for x in (0.2, 0.3, 0.4)], rtol=1e-6)


@pytest.mark.parametrize("mode", ["P", "L"])
def test_a_box_ends_after_the_last_pixel(tmp_path, read, mode):
    save(tmp_path / "0.png", mask({3: (0, 0, 19, 9), 4: (4, 2, 4, 2)}), mode)
    assert read() == [[[(STAR, [0.5, 0.5, 1, 1]), (SQUARE, [0.25, 0.225, 0.1, 0.05])]]]


def test_a_mask_of_one_bit(tmp_path, read):
    Image.fromarray(mask({1: (2, 2, 5, 3)}) > 0).save(tmp_path / "0.png")
    assert read() == [[[(0, [0.3, 0.2, 0.2, 0.2])]]]
    palette = Image.fromarray(mask({1: (2, 2, 5, 3)}))
    palette.putpalette([9, 9, 9, 0, 0, 0])
    palette.save(tmp_path / "0.png", bits=1)
    assert (tmp_path / "0.png").read_bytes()[24:26] == bytes([1, 3])
    assert read() == [[[(0, [0.3, 0.2, 0.2, 0.2])]]]


def test_void_is_nothing_and_an_unseen_object_is_no_box(tmp_path, read):
    save(tmp_path / "0.png", mask({255: (0, 0, 9, 9), 254: (10, 0, 19, 9), 4: (2, 1, 5, 2)}))
    save(tmp_path / "1.png", mask({}))
    save(tmp_path / "3.png", mask({4: (2, 1, 5, 2)}))
    square = (SQUARE, [0.2, 0.2, 0.2, 0.2])
    assert read() == [[[square], [], [], [square]]]


@pytest.mark.parametrize(
    "name, text",
    [
        ("labels.txt", "cat\ngreen_square\n"),
        ("classes.txt", "\ufeffcat\r\nsquare\r\n"),
        ("labels.txt", "background\ncat\nsquare"),
        ("labels.txt", "__Background__\nrobot\ngreen_square\ngreen_star"),
    ],
)
@pytest.mark.parametrize("place", ["", "masks"])
def test_names_beside_masks_decide(tmp_path, read, name, text, place):
    save(tmp_path / "masks/pick/0.png", mask({2: (2, 1, 5, 2)}))
    (tmp_path / place / name).write_text(text, "utf-8")
    assert read() == [[[(SQUARE, [0.2, 0.2, 0.2, 0.2])]]]


@pytest.mark.parametrize(
    "value, text, says",
    [
        (9, None, "0.png: class 9; allowed: 1, 2, 3, 4, 5, 6, 7, 8, named by the object table"),
        (1, "cat\nrobot", "0.png: class 1 is 'cat' by .*labels.txt; allowed: goal_region, robot"),
        (3, "robot\nrobot", "0.png: class 3; allowed: 1, 2, named by .*labels.txt"),
    ],
)
def test_a_value_without_a_name_is_refused(tmp_path, read, value, text, says):
    save(tmp_path / "0.png", mask({value: (2, 1, 5, 2)}))
    if text is not None:
        (tmp_path / "labels.txt").write_text(text)
    with pytest.raises(ImportFailure, match=says):
        read()


def test_folders_are_recordings_in_the_order_of_their_numbers(tmp_path, read):
    for name, left in (("take_2/10", 4), ("take_2/9", 2), ("take_10/1", 6)):
        save(tmp_path / f"{name}.png", mask({4: (2, left, 5, left + 1)}))
    found = read_masks([tmp_path / f"{name}.png" for name in ("take_10/1", "take_2/9", "take_2/10")], tmp_path, OBJECTS)
    assert [[frame[0].box[0].round(3) for frame in one.detections] for one in found] == [
        [np.float32(0.3), np.float32(0.5)],
        [np.float32(0.7)],
    ]


def test_what_is_no_mask_is_one_sentence(tmp_path, capsys):
    folder = tmp_path / "masks"
    arguments = (folder, "--format", "masks")
    save(folder / "0.png", mask({4: (2, 1, 5, 2)}))
    path = folder / "1.png"
    save(path, mask({4: (2, 1, 5, 2)}, (10, 10)))
    assert "1.png: the mask is 10 x 10, but the recording's first one 10 x 20" in refused(capsys, *arguments)
    Image.fromarray(FRAMES[0]).save(path)
    assert "1.png: a PNG of colour type 2 and 8 bits; allowed: masks with a palette" in refused(capsys, *arguments)
    Image.fromarray(np.ones((20, 10), np.uint16)).save(path)
    assert "1.png: a PNG of colour type 0 and 16 bits" in refused(capsys, *arguments)
    Image.fromarray(mask({4: (2, 1, 5, 2)})).save(path, "BMP")
    assert "1.png: no PNG, in which alone values are kept as they are" in refused(capsys, *arguments)
    path.write_bytes((folder / "0.png").read_bytes()[:60])
    assert "1.png: no image that can be read" in refused(capsys, *arguments)
    path.write_bytes(b"")
    assert "1.png: no image that can be read" in refused(capsys, *arguments)
    path.rename(folder / "preview.png")
    assert "preview.png: the name holds no frame number" in refused(capsys, *arguments)
    save(path, mask({255: (2, 1, 5, 2)}))
    (folder / "preview.png").unlink()
    (folder / "0.png").unlink()
    assert "none of the objects goal_region" in refused(capsys, *arguments)


def test_folders_that_may_be_single_objects_are_refused(tmp_path, read):
    """SAM 2 can write a folder per object, in which every mask holds 1."""
    for name in ("001/00000", "001/00001", "002/00000", "002/00001"):
        save(tmp_path / f"pick/{name}.png", mask({1: (2, 1, 5, 2)}))
    with pytest.raises(ImportFailure, match="pick/001: a folder of this name whose masks hold 1 alone may be a single"):
        read()
    for name in ("001", "002"):
        save(tmp_path / f"pick/{name}/00001.png", mask({4: (2, 1, 5, 2)}))
    assert len(read()) == 2


def test_masks_are_told_by_folders_and_values(tmp_path):
    small, grey = mask({2: (2, 1, 5, 2)}), mask({200: (2, 1, 5, 2)})
    save(tmp_path / "Annotations_6fps/a/0.png", mask({}))
    save(tmp_path / "Annotations_6fps/a/1.png", small)
    save(tmp_path / "my_masks/0.png", grey, "L")
    save(tmp_path / "frames/0.png", small)
    Image.fromarray(FRAMES[0]).save(tmp_path / "frames/1.jpg")
    (tmp_path / "mask").mkdir()
    (tmp_path / "mask/0.png").write_bytes(b"")
    files = sorted(path for path in tmp_path.rglob("*.*"))
    named = mask_files([path.relative_to(tmp_path) for path in files])
    assert [str(path.parent) for path in named] == ["Annotations_6fps/a"] * 2 + ["mask", "my_masks"]
    assert first_mask(files) == tmp_path / "Annotations_6fps/a/1.png"
    assert first_mask([tmp_path / "frames/1.jpg", tmp_path / "my_masks/0.png", tmp_path / "mask/0.png"]) is None
    left = {str(path.relative_to(tmp_path)) for path in without_masks(files)}
    assert left == {"frames/0.png", "frames/1.jpg", "mask/0.png", "my_masks/0.png"}
