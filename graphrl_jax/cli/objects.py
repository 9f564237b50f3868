"""`graphrl objects`: a file of objects to fill in; see `requests.Objects`."""

from typing import Any

from graphrl_jax.cli.options import refuse_existing, refuse_useless
from graphrl_jax.cli.requests import Objects
from graphrl_jax.perception.importers.classes import read_classes
from graphrl_jax.perception.objects_file import read_objects, template
from graphrl_jax.storage import write_atomically


def run(request: Objects) -> dict[str, Any]:
    """Carries the request out."""
    refuse_existing(request.out)
    if request.out.suffix != ".toml":
        raise ValueError(f"--out {request.out} must end in .toml")
    labels = list(request.labels)
    if request.classes is not None:
        refuse_useless(request, ["labels"], "with --classes, which names them")
        labels = read_classes(request.classes)
    text = template(request.out.stem, labels)
    write_atomically(request.out, lambda temporary: temporary.write_text(text))
    return {"out": str(request.out), "objects": len(read_objects(request.out).objects.names)}
