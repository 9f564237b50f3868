"""`graphrl demos`: expert demonstrations; see `requests.Demos`."""

from typing import Any

from graphrl_jax import runtime
from graphrl_jax.cli.options import refuse_existing
from graphrl_jax.cli.requests import Demos
from graphrl_jax.experiment.keys import RunStage, stage_key
from graphrl_jax.registry import make_task


def run(request: Demos) -> dict[str, Any]:
    """Carries the request out."""
    runtime.configure()
    refuse_existing(request.out)
    for name, least in (("num", 1), ("failures", 0), ("images", 1)):
        value = getattr(request, name)
        if value is not None and value < least:
            raise ValueError(f"--{name} is {value}; allowed: {least} or more")
    # The key of `train`, so that the same seed gives the same demonstrations.
    key = stage_key(request.seed, RunStage.DEMONSTRATIONS)
    task = make_task(request.task, request.engine)
    made = task.demonstrate(key, request.num, request.failures, request.images)
    made.save(request.out)
    return {"out": str(request.out), "demonstrations": len(made), "successes": int(made.success.sum())}
