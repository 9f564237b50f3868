"""`graphrl stages`: subtasks of demonstrations; see `requests.Stages`."""

from pathlib import Path
from typing import Any

from graphrl_jax import runtime
from graphrl_jax.cli.requests import Stages
from graphrl_jax.experiment.experiment import load_demonstrations
from graphrl_jax.progress import Progress
from graphrl_jax.reward.model import RewardModel
from graphrl_jax.reward.subtasks import demonstration_subtasks
from graphrl_jax.storage import write_json


def run(request: Stages) -> dict[str, Any]:
    """Carries the request out."""
    runtime.configure()
    model = RewardModel.load(request.run)
    assert model.card is not None
    demos = load_demonstrations(request.demos, model.card.objects, model.card.frame_rate, model.card.task)
    found = demonstration_subtasks(model, demos, request.method)
    with Progress() as progress:
        for number, row in enumerate(found["subtasks"], start=1):
            seconds = ", ".join(f"{second:.1f}" for second in row["seconds"])
            told = f"boundaries at {seconds} s" if seconds else "no boundaries"
            progress.note(f"demonstration {number} of {len(demos)}: {told}")
    # A model of the hub has no folder here.
    out = request.out or (request.run if request.run.is_dir() else Path()) / "subtasks.json"
    write_json(out, {"demos": str(request.demos), "method": request.method, **found})
    return {"out": str(out), "demonstrations": len(demos), **found.get("judged", {})}
