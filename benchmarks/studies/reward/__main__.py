"""The command line of the study; see the package."""

import shutil
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import tyro

from benchmarks.context import RESULTS, measured_on
from benchmarks.exploits import landscape_figure, unseen_audit, unseen_trajectories
from benchmarks.studies import reward as study
from benchmarks.studies.reward.report import write_report
from benchmarks.studies.reward.variants import POLICY_VARIANTS, VARIANTS, Variant
from graphrl_jax import demonstrations as demonstration_files
from graphrl_jax.demonstrations import Demonstrations
from graphrl_jax.experiment.checkpoints import TrainedRun
from graphrl_jax.experiment.evaluation import SEED_OFFSET, evaluate_policy
from graphrl_jax.experiment.keys import RunStage, stage_key
from graphrl_jax.experiment.policy_programs import PolicyJob
from graphrl_jax.experiment.presets import PRESETS
from graphrl_jax.experiment.run_directory import Run
from graphrl_jax.experiment.settings import compose
from graphrl_jax.experiment.train_encoder import EncoderJob, train_encoders
from graphrl_jax.experiment.train_policy import train_policies
from graphrl_jax.progress import Progress
from graphrl_jax.registry import make_task
from graphrl_jax.reward.model import fit_reward, load_parameters
from graphrl_jax.runtime import configure
from graphrl_jax.storage import read_json, write_json
from graphrl_jax.task import Task
from tasks.match_regions.task import MatchRegions

FOLDER = Path(__file__).parent
# Everything but the tables is made anew when missing.
RUNS = Path("runs/studies/reward")
# Of the landscape and the trajectories that judge all members alike.
UNSEEN_SEED = 7
DRAWN = ("paper_0", "default_0")


@dataclass(frozen=True)
class Encoders:
    """Train and audit encoders.

    Attributes:
      variants: names in `variants.py`; all if left out.
      seeds: of demonstrations and encoder alike.
    """

    variants: tyro.conf.Positional[tuple[str, ...]] = tuple(VARIANTS)
    seeds: tuple[int, ...] = (0, 1, 2)


@dataclass(frozen=True)
class Policies:
    """Train policies on encoders that `encoders` made.

    Attributes:
      members: such as default_0.
      variant: of the policy's training, see `POLICY_VARIANTS`.
      updates: of PPO.
      episodes: to judge each by: Demo layout, unseen.
    """

    members: tyro.conf.Positional[tuple[str, ...]]
    variant: str = "default"
    updates: int = 100
    episodes: int = 128


@dataclass(frozen=True)
class Report:
    """Write report.md and its figures from the two tables."""


def main() -> None:
    """Entry point."""
    commands = {"encoders": Encoders, "policies": Policies, "report": Report}
    request = tyro.extras.subcommand_cli_from_dict(commands, description=study.__doc__)
    configure()
    if isinstance(request, Encoders):
        encoders(request)
    elif isinstance(request, Policies):
        policies(request)
    else:
        write_report(FOLDER, RESULTS)


def encoders(request: Encoders) -> None:
    """Adds a row to encoders.json for every member that it lacks."""
    task = make_task("match_regions")
    unseen = unseen_trajectories(task, UNSEEN_SEED)
    for name in request.variants:
        for seed in request.seeds:
            member = f"{name}_{seed}"
            if member not in _table("encoders"):
                _add("encoders", member, encoder_row(task, name, seed, unseen))


def policies(request: Policies) -> None:
    """Adds a row to policies.json for every member that it lacks."""
    for encoder in request.members:
        member = encoder if request.variant == "default" else f"{encoder}.{request.variant}"
        if member not in _table("policies"):
            _add("policies", member, policy_row(encoder, member, request))


def encoder_row(task: Task, name: str, seed: int, unseen: Demonstrations) -> dict[str, Any]:
    """Trains one encoder; its audit with the goal of rearrangements and with that of the demonstrations alone."""
    variant = VARIANTS[name]
    config, hyper = variant.settings()
    # Left by an interrupted training; a finished one has its row.
    shutil.rmtree(RUNS / f"{name}_{seed}", ignore_errors=True)
    run = Run.create(RUNS / f"{name}_{seed}", "study", {"variant": name, "seed": seed})
    job = EncoderJob(run, _demonstrations(task, variant, seed), hyper, seed)
    with Progress() as progress:
        ((model, metrics),) = train_encoders([job], config, progress)
    bare = fit_reward(model.params, job.split[0], model.pooling, even=hyper.even, exponent=hyper.exponent)
    if f"{name}_{seed}" in DRAWN:
        landscape_figure(task, model, UNSEEN_SEED, FOLDER / f"landscape_{name}.png")
    return {
        "variant": name,
        "factor": variant.factor,
        "seed": seed,
        "pretrain_s": metrics["pretrain_s"],
        **unseen_audit(task, model, unseen, UNSEEN_SEED),
        "demonstrated_goal": unseen_audit(task, bare, unseen, UNSEEN_SEED),
    }


def policy_row(encoder: str, member: str, request: Policies) -> dict[str, Any]:
    """Trains one policy on the frozen reward of one encoder alone, and evaluates it on the Demo layout."""
    name, seed = encoder.rsplit("_", 1)
    config, hyper = VARIANTS[name].settings()
    change = POLICY_VARIANTS[request.variant]
    task = MatchRegions(**change.task)
    reward_params = load_parameters(RUNS / encoder, config.encoder, config.activity, task.objects)
    method = "graph" if hyper.suppress_robot else "graph_with_robot"
    settings = compose(task, method, seed=int(seed), updates=request.updates, ppo=change.hyper)
    settings = replace(settings, pretrain_config=config, pretrain=hyper)
    # Made by `encoders`, or by an interrupted training of this policy, which goes on.
    run = Run(RUNS / member) if (RUNS / member).exists() else Run.start(RUNS / member, settings)
    with Progress() as progress:
        ((policy, metrics),) = train_policies([PolicyJob(run, settings, reward_params)], task, progress)
    trained = TrainedRun(task, settings, reward_params, policy)
    curve = [[record["env_steps"], record["success"], record["score"]] for record in run.records("ppo")]
    return {
        "encoder": encoder,
        "variant": request.variant,
        "updates": request.updates,
        **metrics,
        **evaluate_policy(trained, request.episodes, settings.seed + SEED_OFFSET),
        "training_seed": int(seed),
        "curve": curve,
    }


def _demonstrations(task: Task, variant: Variant, seed: int) -> Demonstrations:
    path = RUNS / f"demonstrations_{variant.demonstrations}_{seed}.npz"
    if not path.exists():
        key = stage_key(seed, RunStage.DEMONSTRATIONS)
        task.demonstrate(key, variant.demonstrations, PRESETS["cpu"].demonstrations // 4).save(path)
    return demonstration_files.load(path)


def _table(name: str) -> dict[str, Any]:
    path = FOLDER / f"{name}.json"
    return read_json(path) if path.exists() else {}


def _add(name: str, member: str, row: dict[str, Any]) -> None:
    # Read again: another process may have added rows meanwhile.
    write_json(FOLDER / f"{name}.json", {**_table(name), member: {**row, **measured_on("studies.reward")}})


if __name__ == "__main__":
    main()
