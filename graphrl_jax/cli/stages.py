"""`graphrl stages`: subtasks of demonstrations; see `requests.Stages`."""

from typing import Any

from graphrl_jax import runtime
from graphrl_jax.cli.requests import Stages
from graphrl_jax.experiment.experiment import load_demonstrations
from graphrl_jax.experiment.run_directory import Run
from graphrl_jax.registry import make_task
from graphrl_jax.reward.model import load_parameters
from graphrl_jax.reward.subtasks import demonstration_subtasks
from graphrl_jax.storage import write_json


def run(request: Stages) -> dict[str, Any]:
    """Carries the request out."""
    runtime.configure()
    run = Run(request.run)
    settings = run.settings("train", "pretrain")
    task = make_task(settings.task)
    demos = load_demonstrations(request.demos, task)
    config = settings.pretrain_config
    model = load_parameters(run.path, config.encoder, config.activity, task.objects)
    found = demonstration_subtasks(model, demos, request.method)
    out = request.out or run.path / "subtasks.json"
    write_json(out, {"demos": str(request.demos), "method": request.method, **found})
    return {"out": str(out), "demonstrations": len(demos), **found.get("judged", {})}
