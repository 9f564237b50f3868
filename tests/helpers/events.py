"""TensorBoard's event files, read back."""

import struct
from pathlib import Path
from typing import Any

from tensorboardX.proto.event_pb2 import Event


def logged(folder: Path) -> list[tuple[int, str, Any]]:
    """Step, name and value (a number, the bytes of an image, or a text) of all that a folder's event files hold."""
    found = []
    for file in sorted(folder.glob("events*")):
        content, at = file.read_bytes(), 0
        while at < len(content):
            # A record: its length, a checksum, the event, a checksum.
            (length,) = struct.unpack("<Q", content[at : at + 8])
            event = Event.FromString(content[at + 12 : at + 12 + length])
            found += [(event.step, value.tag, _value(value)) for value in event.summary.value]
            at += length + 16
    return found


def numbers(folder: Path, section: str) -> dict[int, dict[str, float]]:
    """Numbers of a section by step and name."""
    found: dict[int, dict[str, float]] = {}
    for step, tag, value in logged(folder):
        if isinstance(value, float) and tag.split("/")[0] == section:
            assert tag not in found.setdefault(step, {}), f"{tag} is logged twice at step {step}"
            found[step][tag] = value
    return found


def _value(value: Any) -> Any:
    if value.HasField("image"):
        return value.image.encoded_image_string
    return value.simple_value if value.HasField("simple_value") else value.tensor.string_val[0].decode()
