"""The source of recordings that `graphrl import` and `graphrl score` are asked to read."""

from graphrl_jax.cli.options import refuse_useless
from graphrl_jax.cli.requests import Import, Score
from graphrl_jax.perception.config import CAMERA_FORMATS, SIZED_FORMATS
from graphrl_jax.perception.importers.convert import Source


def source_of(request: Import | Score) -> Source:
    """The source of a request, after a check that its options are of use to the format.

    Raises:
      ValueError: the source cannot be read, or an option changes nothing about its format.
    """
    source = Source(request.source, request.format, request.size, request.camera)
    if source.format not in SIZED_FORMATS:
        refuse_useless(request, ["size"], f"with format {source.format}, whose files say it")
    if source.format not in CAMERA_FORMATS:
        refuse_useless(request, ["camera"], f"with format {source.format}, whose files have one view")
    return source
