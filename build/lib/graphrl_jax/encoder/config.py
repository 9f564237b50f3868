"""Kinds and sizes of encoders. Plain Python: the command line reads these fields without JAX."""

from dataclasses import dataclass, field
from typing import Literal, get_args

Kind = Literal["message_passing", "interaction", "pixels"]
KINDS: tuple[str, ...] = get_args(Kind)
DecoderInput = Literal["node", "pooled"]
DECODER_INPUTS: tuple[str, ...] = get_args(DecoderInput)
ActivityRule = Literal["displacement", "frame_motion", "momentary"]
"""Rules by which an object becomes active (`graph.update_activity`)."""
ACTIVITY_RULES: tuple[str, ...] = get_args(ActivityRule)


@dataclass(frozen=True)
class PixelConfig:
    """Sizes of XIRL's network (`pixels.py`), all static.

    Attributes:
      size: edge of an image, in pixels.
      patch: edge of the patches of the first level, in pixels.
      widths: channels after each level; the first level cuts the image into patches, the others halve the resolution.
      blocks: residual blocks per level.

    Raises:
      ValueError: a field is too small, or the levels do not divide the image; the message names it.
    """

    size: int = 64
    patch: int = 4
    widths: tuple[int, ...] = (32, 32, 64)
    blocks: int = 0

    def __post_init__(self) -> None:
        for name, least in (("size", 1), ("patch", 1), ("blocks", 0)):
            if getattr(self, name) < least:
                raise ValueError(f"PixelConfig.{name} must be at least {least}, got {getattr(self, name)}")
        if not self.widths or min(self.widths) < 1:
            raise ValueError(f"PixelConfig.widths must be positive, at least one, got {self.widths}")
        step = self.patch * 2 ** (len(self.widths) - 1)
        if self.size % step:
            raise ValueError(f"PixelConfig.size must be a multiple of {step}, got {self.size}")

    @property
    def positions(self) -> int:
        """Positions along an edge of the last feature map."""
        return self.size // (self.patch * 2 ** (len(self.widths) - 1))


RESNET_18 = PixelConfig(widths=(64, 128, 256, 512), blocks=2, patch=2)
"""Sizes for a GPU, close to ResNet-18."""


@dataclass(frozen=True)
class EncoderConfig:
    """Kind and sizes of an encoder, all static.

    Attributes:
      kind: `message_passing` (ours), `interaction` (GraphIRL: one round, no head) or `pixels` (XIRL: images).
      embedding: D, size of the embedding; the only size that every kind uses.
      num_layers: rounds of message passing; 0 embeds every object separately.
      hidden: H, size of node embeddings, messages and the head's hidden layers.
      head_layers: hidden layers of the head; 0 makes it linear.
      edges: use offsets and distances on the edges; False is an ablation.
      pixels: sizes of XIRL's network.

    Raises:
      ValueError: a size is too small or the kind is unknown; the message names it.
    """

    kind: Kind = "message_passing"
    embedding: int = 32
    num_layers: int = 2
    hidden: int = 32
    head_layers: int = 1
    edges: bool = True
    pixels: PixelConfig = field(default_factory=PixelConfig)

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ValueError(f"EncoderConfig.kind must be one of {', '.join(KINDS)}, got {self.kind!r}")
        for name, least in (("num_layers", 0), ("hidden", 1), ("embedding", 1), ("head_layers", 0)):
            if getattr(self, name) < least:
                raise ValueError(f"EncoderConfig.{name} must be at least {least}, got {getattr(self, name)}")

    @property
    def image_size(self) -> int | None:
        """Edge of the input images in pixels; None if the input is a graph."""
        return self.pixels.size if self.kind == "pixels" else None
