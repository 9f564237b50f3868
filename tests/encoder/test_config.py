"""Sizes of encoders: what is not allowed is named."""

from dataclasses import replace

import pytest

from graphrl_jax.encoder.config import KINDS, RESNET_18, EncoderConfig, PixelConfig


@pytest.mark.parametrize("field, value", [("num_layers", -1), ("hidden", 0), ("embedding", 0), ("head_layers", -1)])
def test_a_wrong_size_names_the_field(field, value):
    with pytest.raises(ValueError, match=f"EncoderConfig.{field} must be at least .*, got {value}"):
        EncoderConfig(**{field: value})


def test_an_unknown_kind_lists_the_known_ones():
    known = "message_passing, interaction, pixels"
    with pytest.raises(ValueError, match=f"EncoderConfig.kind must be one of {known}, got 'transformer'"):
        EncoderConfig(kind="transformer")  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"size": 60}, "PixelConfig.size must be a multiple of 16, got 60"),
        ({"size": 0}, "PixelConfig.size must be at least 1, got 0"),
        ({"widths": ()}, "PixelConfig.widths must be positive"),
        ({"widths": (8, 0)}, "PixelConfig.widths must be positive"),
        ({"patch": 0}, "PixelConfig.patch must be at least 1, got 0"),
        ({"blocks": -1}, "PixelConfig.blocks must be at least 0, got -1"),
    ],
)
def test_sizes_that_do_not_fit_are_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        replace(PixelConfig(), **changes)


def test_the_last_feature_map_follows_from_patch_and_levels():
    assert PixelConfig(size=64, patch=4, widths=(8, 8, 8)).positions == 4
    assert RESNET_18.positions == 4


@pytest.mark.parametrize("kind", KINDS)
def test_only_pixels_are_seen_as_an_image(kind):
    config = EncoderConfig(kind=kind, pixels=PixelConfig(size=32))
    assert config.image_size == (32 if kind == "pixels" else None)
