"""The file format: lossless round trips, and one clear sentence for everything that is wrong."""

import os
from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from graphrl_jax.demonstrations import DemonstrationError, Demonstrations, load, reached_for_good
from tests.helpers.demonstrations import demonstrations

PLAIN = demonstrations(num=4, num_frames=10)


def full() -> Demonstrations:
    """With every optional field."""
    random = np.random.default_rng(0)
    return replace(
        PLAIN,
        events=np.array([[2, 4], [-1, 5], [0, -1], [-1, -1]], np.int32),
        event_names=("first placed", "second placed"),
        kinds=np.array(["success", "one_target", "success", "échec"]),
        frames=random.integers(0, 256, (4, 10, 3, 5, 3), dtype=np.uint8),
    )


def assert_same(first: Demonstrations, second: Demonstrations) -> None:
    for field in fields(Demonstrations):
        one, other = getattr(first, field.name), getattr(second, field.name)
        if isinstance(one, np.ndarray):
            assert one.dtype == other.dtype, field.name
            np.testing.assert_array_equal(one, other)
        else:
            assert one == other, field.name


@pytest.mark.parametrize("demos", [PLAIN, full()], ids=["plain", "full"])
def test_round_trip_loses_nothing(tmp_path, demos):
    path = tmp_path / "new folder" / "demos.npz"
    demos.save(path)
    assert_same(load(path), demos)


@settings(max_examples=10, deadline=None)
@given(
    frame_rate=st.floats(0.001, 1e6),
    source=st.text(st.characters(exclude_categories=("Cs",), exclude_characters="\0"), max_size=20),
    seed=st.integers(0, 2**16),
)
def test_round_trip_keeps_every_bit(tmp_path_factory, frame_rate, source, seed):
    random = np.random.default_rng(seed)
    boxes = random.uniform(-0.5, 1.5, PLAIN.boxes.shape).astype(np.float32)
    boxes[..., 2:] = np.abs(boxes[..., 2:])
    demos = replace(PLAIN, boxes=boxes, frame_rate=frame_rate, source=source)
    path = tmp_path_factory.mktemp("demos") / "demos.npz"
    demos.save(path)
    assert_same(load(path), demos)


@pytest.mark.parametrize("field", ["is_fixture", "is_articulated"])
def test_flags_of_objects_are_kept_and_a_file_without_them_has_none(tmp_path, field):
    flags = (False, False, True, False)
    demos = replace(PLAIN, objects=replace(PLAIN.objects, **{field: flags}))
    demos.save(tmp_path / "new.npz")
    assert load(tmp_path / "new.npz").objects == demos.objects and getattr(demos.objects, field) == flags
    with np.load(tmp_path / "new.npz") as archive:
        np.savez(tmp_path / "old.npz", **{name: archive[name] for name in archive.files if name != field})
    assert_same(load(tmp_path / "old.npz"), PLAIN)


def test_saving_is_all_or_nothing(tmp_path, monkeypatch):
    path = tmp_path / "demos"
    PLAIN.save(path)

    def fail(*_args, **_kwargs):
        raise OSError("disk full")

    monkeypatch.setattr(np, "savez_compressed", fail)
    with pytest.raises(OSError, match="disk full"):
        full().save(path)
    assert_same(load(path), PLAIN)
    assert os.listdir(tmp_path) == ["demos"]


def saved_entries(tmp_path) -> dict:
    full().save(tmp_path / "good.npz")
    with np.load(tmp_path / "good.npz") as archive:
        return dict(archive)


def load_with(tmp_path, **changes):
    """Loads a file with some fields replaced, or left out where the new value is None."""
    entries = {**saved_entries(tmp_path), **changes}
    np.savez(tmp_path / "bad.npz", **{name: value for name, value in entries.items() if value is not None})
    return load(tmp_path / "bad.npz")


def assert_refuses(says: str, function, *args, **kwargs) -> None:
    """One sentence on one line, with `says` in it."""
    with pytest.raises(DemonstrationError) as caught:
        function(*args, **kwargs)
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


def boxes_with(index, value):
    boxes = PLAIN.boxes.copy()
    boxes[index] = value
    return boxes


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        (dict(version=None), "field 'version' is missing"),
        (dict(version=np.int32(2)), "field 'version' is 2, but this release reads version 1 only"),
        (dict(version=np.array("one")), "field 'version' is one"),
        (dict(boxes=None), "field 'boxes' is missing"),
        (dict(success=None), "field 'success' is missing"),
        (dict(class_names=None), "field 'class_names' is missing"),
        (dict(event=np.zeros(3)), "field 'event' is unknown; the known ones are boxes, mask"),
        (dict(boxes=PLAIN.boxes[0]), "boxes must be an array of shape (B, T, N, 4), got shape (10, 4, 4)"),
        (dict(boxes=PLAIN.boxes[..., :3]), "boxes must have shape (4, 10, 4, 4), got (4, 10, 4, 3)"),
        (dict(boxes=PLAIN.boxes[:0]), "boxes must hold at least one demonstration"),
        (dict(boxes=PLAIN.boxes.astype(np.float64)), "boxes must have dtype float32, got float64"),
        (dict(boxes=boxes_with((1, 2, 0, 3), np.nan)), "boxes[1, 2, 0, 3] is nan; allowed are finite numbers"),
        (dict(boxes=boxes_with((0, 0, 3, 0), np.inf)), "boxes[0, 0, 3, 0] is inf; allowed are finite numbers"),
        (dict(boxes=boxes_with((0, 1, 2, 0), 1.6)), "boxes[0, 1, 2, 0] is 1.6; allowed are -0.5 to 1.5"),
        (dict(boxes=boxes_with((0, 1, 2, 2), -0.1)), "boxes[0, 1, 2, 2] is -0.1; widths and heights must not"),
        (dict(mask=PLAIN.mask[:, :5]), "mask must have shape (4, 10, 4), got (4, 5, 4)"),
        (dict(mask=PLAIN.mask.astype(np.int8)), "mask must have dtype bool, got int8"),
        (dict(lengths=np.array([10, 0, 9, 9], np.int32)), "lengths[1] is 0; allowed are 1 to 10"),
        (dict(lengths=np.array([10, 9, 9, 11], np.int32)), "lengths[3] is 11; allowed are 1 to 10"),
        (dict(lengths=np.array([10, 9, 9, 9])), "lengths must have dtype int32, got int64"),
        (dict(success=np.ones(3, bool)), "success must have shape (4,), got (3,)"),
        (dict(class_ids=np.array([0, 1, 2, 7], np.int32)), "class_ids holds 7; allowed are 0 to 2"),
        (dict(class_ids=np.int32(0)), "class_ids must have one axis, got shape ()"),
        (dict(names=np.array(["a", "a", "b", "c"])), "names must hold at least one name and no name twice"),
        (dict(names=np.array(["a", "b", "c"])), "class_ids has 4 entries, but names has 3"),
        (dict(is_robot=np.zeros(4, np.int32)), "is_robot must hold bool values only, got 0"),
        (dict(is_articulated=np.zeros(3, bool)), "is_articulated has 3 entries, but names has 4"),
        (dict(is_articulated=np.bool_(True)), "is_articulated must have one axis, got shape ()"),
        (dict(frame_rate=np.array([8.0])), "frame_rate must be a single value, got shape (1,)"),
        (dict(frame_rate=np.array(0.0)), "frame_rate must be a positive number, got 0.0"),
        (dict(frame_rate=np.array(np.nan)), "frame_rate must be a positive number, got nan"),
        (dict(frame_rate=np.array("8 Hz")), "frame_rate must be a positive number, got '8 Hz'"),
        (dict(task=np.array(3)), "task must be a text, got 3"),
        (dict(events=None), "events is missing, but event_names lists"),
        (dict(events=np.zeros((4, 3), np.int32)), "events must have shape (4, 2), got (4, 3)"),
        (dict(events=np.full((4, 2), 10, np.int32)), "events[0, 0] (first placed) is 10; allowed are -1 for never"),
        (dict(events=np.full((4, 2), -2, np.int32)), "events[0, 0] (first placed) is -2; allowed are -1 for never"),
        (dict(kinds=np.arange(4)), "kinds must have dtype str_, got int64"),
        (dict(frames=np.zeros((4, 10, 3, 5), np.uint8)), "frames must have shape (4, 10, 3, 5, 3), got (4, 10, 3, 5)"),
        (dict(frames=np.zeros((4, 10, 3, 5, 3), np.float32)), "frames must have dtype uint8, got float32"),
        (dict(source=np.array(object())), "field 'source' cannot be read"),
    ],
)
def test_a_wrong_field_is_named(tmp_path, changes, says):
    assert_refuses(says, load_with, tmp_path, **changes)


def test_what_stands_in_masked_slots_and_padding_need_not_be_in_the_image():
    boxes = PLAIN.boxes.copy()
    boxes[:, :, 3] = 1e30
    boxes[1, PLAIN.lengths[1] :] = -1e30
    assert len(replace(PLAIN, boxes=boxes)) == 4


def test_a_missing_file_a_folder_and_another_format_are_told_apart(tmp_path):
    assert_refuses("nowhere.npz: there is no such file", load, tmp_path / "nowhere.npz")
    assert_refuses("there is no such file", load, tmp_path)
    np.save(tmp_path / "array.npy", np.zeros(3))
    assert_refuses("not an .npz file, or a truncated one", load, tmp_path / "array.npy")
    (tmp_path / "empty.npz").touch()
    assert_refuses("not an .npz file, or a truncated one", load, tmp_path / "empty.npz")


@pytest.mark.parametrize("kept", [0.1, 0.5, 0.99])
def test_a_truncated_file_is_refused(tmp_path, kept):
    PLAIN.save(tmp_path / "demos.npz")
    content = (tmp_path / "demos.npz").read_bytes()
    (tmp_path / "demos.npz").write_bytes(content[: int(kept * len(content))])
    assert_refuses("truncated", load, tmp_path / "demos.npz")


def test_a_damaged_field_is_named(tmp_path):
    PLAIN.save(tmp_path / "demos.npz")
    content = bytearray((tmp_path / "demos.npz").read_bytes())
    start = content.index(b"boxes.npy") + 100
    content[start : start + 40] = bytes(40)
    (tmp_path / "demos.npz").write_bytes(content)
    assert_refuses("field 'boxes' cannot be read, the file is damaged", load, tmp_path / "demos.npz")


def test_select_takes_indices_in_order_and_booleans():
    demos = full()
    chosen = demos.select([2, 0])
    np.testing.assert_array_equal(chosen.boxes, demos.boxes[[2, 0]])
    np.testing.assert_array_equal(chosen.events, demos.events[[2, 0]])
    assert list(chosen.kinds) == ["success", "success"] and chosen.frames.shape[0] == 2
    assert_same(demos.select(np.array([True, False, True, False])), demos.select([0, 2]))
    assert_refuses("must keep at least one", demos.select, [])
    assert_refuses("must keep at least one", demos.select, np.zeros(4, bool))


def test_successes():
    demos = replace(PLAIN, success=np.array([True, False, False, True]))
    np.testing.assert_array_equal(demos.successes().boxes, PLAIN.boxes[[0, 3]])


@settings(max_examples=10, deadline=None)
@given(st.floats(0.01, 0.99), st.integers(0, 2**16))
def test_split_parts_every_demonstration_once(fraction, seed):
    demos = replace(PLAIN, kinds=np.array(["a", "b", "c", "d"]))
    train, held_out = demos.split(fraction, seed)
    assert sorted([*train.kinds, *held_out.kinds]) == ["a", "b", "c", "d"]
    assert len(train) == min(max(round(4 * fraction), 1), 3)
    assert_same(demos.split(fraction, seed)[0], train)


def test_split_refuses_what_cannot_be_split():
    assert_refuses("fraction of a split must lie between 0 and 1, got 1", PLAIN.split, 1, 0)
    assert_refuses("a split needs at least 2 demonstrations, got 1", PLAIN.select([0]).split, 0.5, 0)


def moving(frame_rate: float, seconds: float = 2.0) -> Demonstrations:
    """One object that moves along x by 0.1 a second, one that is never seen."""
    number = round(seconds * frame_rate) + 1
    base = demonstrations(num=2, num_frames=number)
    boxes = np.full_like(base.boxes, 0.2)
    boxes[..., 0, 0] = 0.1 + 0.1 * np.arange(number) / frame_rate
    mask = np.zeros_like(base.mask)
    mask[..., 0] = True
    lengths = np.full(2, number, np.int32)
    return replace(base, boxes=boxes, mask=mask, lengths=lengths, frame_rate=frame_rate, events=None, event_names=())


@pytest.mark.parametrize("rate", [4.0, 8.0, 20.0, 30.0, 60.0])
def test_resampled_demonstrations_show_the_same_motion(rate):
    found, expected = moving(rate).resampled(8.0), moving(8.0)
    np.testing.assert_array_equal(found.lengths, expected.lengths)
    np.testing.assert_allclose(found.boxes[..., 0, :], expected.boxes[..., 0, :], atol=1e-6)
    np.testing.assert_array_equal(found.mask, expected.mask)
    assert found.frame_rate == 8.0
    if rate != 8.0:
        assert found.source.endswith(f", resampled from {rate:g} to 8 frames per second")


def test_resampling_interpolates_only_between_frames_that_show_the_object():
    demos = moving(8.0, 0.5)
    mask = demos.mask.copy()
    mask[:, 2, 0] = False
    images = np.arange(5, dtype=np.uint8).reshape(1, 5, 1, 1, 1) * np.ones((2, 5, 1, 1, 3), np.uint8)
    events = np.array([[1], [-1]], np.int32)
    demos = replace(demos, mask=mask, frames=images, events=events, event_names=("placed",))
    found = demos.resampled(16.0)
    np.testing.assert_array_equal(found.lengths, [9, 9])
    # Halves round to the even frame: 0.5 -> 0, 1.5 -> 2, 2.5 -> 2, 3.5 -> 4.
    np.testing.assert_array_equal(found.frames[0, :, 0, 0, 0], [0, 0, 1, 2, 2, 2, 3, 4, 4])
    np.testing.assert_array_equal(found.mask[0, :, 0], [1, 1, 1, 0, 0, 0, 1, 1, 1])
    x = np.asarray(found.boxes[0, :, 0, 0])
    np.testing.assert_allclose(x[[0, 1, 2, 6, 7, 8]], 0.1 + 0.1 * np.array([0, 1, 2, 6, 7, 8]) / 16, atol=1e-6)
    np.testing.assert_array_equal(found.events, [[2], [-1]])


def test_a_demonstration_of_endless_frames_is_refused():
    with pytest.raises(DemonstrationError, match="at 1e-06 frames per second has 32000001 frames at 8; allowed: up to"):
        replace(moving(8.0, 0.5), frame_rate=1e-6).resampled(8.0)


def test_images_are_the_frames_and_of_one_size():
    demos = replace(PLAIN, frames=np.zeros((4, 10, 6, 6, 3), np.uint8))
    assert demos.images(6) is demos.frames
    assert_refuses("frames must be images of 8 x 8 pixels, got those of 6 x 6 pixels", demos.images, 8)
    assert_refuses("frames must be images of 8 x 8 pixels, got none", PLAIN.images, 8)


def test_classes_are_the_tables_unless_demonstrations_have_their_own():
    np.testing.assert_array_equal(PLAIN.class_ids(), [PLAIN.objects.class_ids] * 4)
    own = np.array([[0, 1, 2, 1], [0, 2, 2, 1], [0, 1, 1, 1], [0, 1, 2, 0]], np.int32)
    demos = replace(PLAIN, classes=own)
    np.testing.assert_array_equal(demos.class_ids(), own)
    np.testing.assert_array_equal(demos.select([2, 0]).class_ids(), own[[2, 0]])
    assert_refuses("classes[0, 0] is 3; allowed are 0 to 2", replace, PLAIN, classes=own + 3)


def test_an_event_counts_from_the_frame_after_which_it_always_holds():
    reached = np.array([[[0, 1, 1, 0], [1, 1, 0, 0], [0, 1, 1, 0], [1, 1, 1, 0]]], bool)
    np.testing.assert_array_equal(reached_for_good(reached), [[3, 0, 2, -1]])
    # A demonstration that is cut after two frames knows nothing of the rest, and one of all frames is as above.
    both = np.repeat(reached, 2, axis=0)
    np.testing.assert_array_equal(reached_for_good(both, np.array([2, 4])), [[1, 0, -1, -1], [3, 0, 2, -1]])
