"""`graphrl pretrain`: an encoder alone, with its audit; see `requests.Pretrain`."""

from typing import Any

from graphrl_jax import demonstrations, runtime
from graphrl_jax.cli.options import asked_for
from graphrl_jax.cli.requests import Pretrain
from graphrl_jax.experiment.audit import audit_reward
from graphrl_jax.experiment.environments import drawer_of, refuse_undrawn
from graphrl_jax.experiment.experiment import given_demonstrations
from graphrl_jax.experiment.recorded import RecordedTask, task_of
from graphrl_jax.experiment.run_directory import Run
from graphrl_jax.experiment.settings import as_json, compose
from graphrl_jax.experiment.train_encoder import EncoderJob, train_encoders
from graphrl_jax.progress import Progress
from graphrl_jax.reward.card import write_card
from graphrl_jax.storage import write_json


def run(request: Pretrain) -> dict[str, Any]:
    """Carries the request out."""
    runtime.configure()
    task = task_of(demonstrations.load(request.demos))
    settings = compose(
        task,
        request.reward,
        seed=request.seed,
        demos=str(request.demos),
        ablations=request.ablate,
        pretrain=asked_for(request.pretrain),
    )
    if settings.method.encoder is None:
        raise ValueError(f"reward {request.reward!r} has no encoder to train")
    refuse_undrawn(task, settings.reward, settings.pretrain.rearranged)
    demos = given_demonstrations(task, settings)
    folder = Run.create(request.out, "pretrain", as_json(settings))
    job = EncoderJob(folder, demos, settings.pretrain, settings.seed, drawer_of(task, settings))
    with Progress() as progress:
        ((model, metrics),) = train_encoders([job], settings.pretrain_config, progress)
        # Rearrangements of what the encoder has seen would say too little.
        audited = RecordedTask(job.split[1]) if isinstance(task, RecordedTask) else task
        progress.note(f"auditing {folder.path.name}")
        metrics |= audit_reward(job, audited, model, settings.step_discount)
        assert model.card is not None
        write_card(folder.path, model.card, metrics)
    write_json(folder.path / "summary.json", {**metrics, "versions": runtime.versions(), "device": runtime.device()})
    return {"out": str(folder.path), **{name: value for name, value in metrics.items() if isinstance(value, float)}}
