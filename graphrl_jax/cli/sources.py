"""What `graphrl import` and `graphrl score` are asked to read, and what finds the objects in it."""

from graphrl_jax.cli.options import refuse_useless
from graphrl_jax.cli.requests import Import, Score
from graphrl_jax.graph import ObjectTable
from graphrl_jax.perception.config import CAMERA_FORMATS, SIZED_FORMATS
from graphrl_jax.perception.detector import Detector, NoDetector
from graphrl_jax.perception.importers.convert import Source
from graphrl_jax.perception.model_detector import ultralytics


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


def detector_of(request: Import | Score, objects: ObjectTable, own: Detector | None) -> Detector:
    """What finds the objects in images: the model of --weights, else what there is without it.

    Args:
      request: the request.
      objects: the objects to find.
      own: finds them without --weights; None if nothing does, and then images are refused.
    """
    if request.weights is not None:
        return ultralytics(request.weights, objects)
    return own or NoDetector(_why_nothing_finds(request))


def _why_nothing_finds(request: Import | Score) -> str:
    """Why there is no detector, and what to do about it."""
    if request.objects is not None:
        lack, way = f"{request.objects} gives its objects no colours", "a colour for every object, or "
    elif isinstance(request, Score):
        lack, way = f"{request.model} does not say how its objects look", "--objects FILE with their colours, or "
    else:
        lack, way = f"task {request.task} has no detector for its objects", ""
    return f"{lack}, so nothing finds them in images; allowed: {way}--weights MODEL"
