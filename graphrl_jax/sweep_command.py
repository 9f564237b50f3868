"""`python -m graphrl_jax sweep`: floats times seeds, all encoders in one program and all policies in another.

Every member gets a run folder that can be evaluated and read alone like one of `train.py`; what training needs to go on
is kept for groups of members. `sweep.json` and `figures/sweep.png` put them together. An interrupted sweep goes on with
`--resume`.
"""

import itertools
import json
import math
import shutil
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from graphrl_jax import compilation, demonstrations, pipeline, plots, runs
from graphrl_jax.evaluators import interval
from graphrl_jax.ppo_config import PPOHyper
from graphrl_jax.pretrain import PretrainHyper
from graphrl_jax.progress import Progress
from graphrl_jax.runs import Run, RunError
from graphrl_jax.settings import Settings, default_preset
from graphrl_jax.task import Task, make_task
from graphrl_jax.training import EncoderJob, PolicyJob, train_encoders, train_policies

_GROUPS: dict[str, type] = {"pretrain": PretrainHyper, "ppo": PPOHyper}
_OF_PIXELS = ("learning_rate", "final_learning_rate", "warmup", "weight_decay", "max_grad_norm", "tau", "temperature",
              "tcc_weight", "even")  # fmt: skip
_AUDITED = ("pair_accuracy", "finished_above_unfinished", "maxima_inside", "within_above_beside", "bump_bonus")


@dataclass(frozen=True)
class Sweep:
    """Train encoders and policies for several values of some floats, times seeds, side by side.

    Attributes:
      out: Folder of the sweep; each member is a run folder in it.
      task: Registered task.
      reward: graph, graph_with_robot, graphirl, graphirl_with_robot, xirl, or env (then policies alone).
      preset: smoke, cpu or gpu; chosen for the device if left out.
      demos: Demonstration file; the expert makes each seed's if none is given.
      alphas: Weights of objects that have moved, such as 1,2,4,8,16.
      sweep: Further fields, such as pretrain.reconstruction_weight=0.1,1 ppo.learning_rate=3e-4,1e-3.
      seeds: How many seeds.
      first_seed: The first of them.
      updates: Policy updates; the preset's number if left out.
      encoder_steps: Steps of pretraining; the preset's number if left out.
      encoders_only: Train and audit encoders, no policies.
      resume: Continue the sweep in --out; its own settings are used.
    """

    out: Path
    task: str = "match_regions"
    reward: str = "graph"
    preset: str | None = None
    demos: Path | None = None
    alphas: str | None = None
    sweep: tuple[str, ...] = ()
    seeds: int = 1
    first_seed: int = 0
    updates: int | None = None
    encoder_steps: int | None = None
    encoders_only: bool = False
    resume: bool = False


@dataclass(frozen=True)
class Member:
    """One member: what was swept, and the run it would be alone."""

    swept: dict[str, float]
    run: Run
    settings: Settings


def sweep(request: Sweep) -> None:
    """See `Sweep`."""
    started = time.perf_counter()
    compile_log = compilation.configure()
    if request.resume:
        request = _resumed(request)
    task = make_task(request.task)
    members = planned(request, task)
    pipeline.refuse_undrawn(task, request.reward)
    if request.demos is not None:
        pipeline.given_demonstrations(task, members[0].settings)
    if not request.resume:
        # Resumed on another device, it keeps the sizes it began with.
        kept = runs.plain(asdict(request) | {"preset": members[0].settings.preset})
        Run.create(request.out, {"command": "sweep", "version": runs.VERSION, **kept})
    for member in members:
        if not member.run.path.exists():
            config = {"command": "train", "version": runs.VERSION, **asdict(member.settings)}
            Run.create(member.run.path, config)
    with Progress() as progress:
        learned = request.reward != "env"
        encoders = _encoders(members, task, progress) if learned else [{}] * len(members)
        outcomes = [{}] * len(members) if request.encoders_only else _policies(members, task, progress, request.out)
    rows = [
        {**outcome, **encoder, "member": member.run.path.name, "seed": member.settings.seed, "swept": member.swept}
        for member, outcome, encoder in zip(members, outcomes, encoders, strict=True)
    ]
    report = {
        "members": rows,
        "wall_s": time.perf_counter() - started,
        "compile_s": compile_log.seconds,
        "compilation_cache": compile_log.cache,
        "versions": runs.versions(),
        "device": runs.device(),
    }
    runs.write_json(request.out / "sweep.json", report)
    field = next(iter(members[0].swept), None)
    if field is not None:
        plots.sweep(rows, field, request.out / "figures" / "sweep.png")
    _print(rows)
    print(json.dumps({"out": str(request.out), "members": len(rows), "wall_s": round(report["wall_s"], 1)}))


def planned(request: Sweep, task: Task) -> list[Member]:
    """The members: every combination of the swept values with every seed.

    Raises:
      ValueError: a field is unknown or given twice, a value is no number, or there is no seed.
    """
    if request.seeds < 1:
        raise ValueError(f"--seeds is {request.seeds}; allowed: 1 or more")
    values = swept_values(request)
    members = []
    for combination in itertools.product(*values.values()):
        swept = dict(zip(values, combination, strict=True))
        changes: dict[str, dict[str, float]] = {group: {} for group in _GROUPS}
        for name, value in swept.items():
            group, field = name.split(".")
            changes[group][field] = value
        hyper = pipeline.pretrain_hyper(task, PretrainHyper().alpha, request.reward)
        for seed in range(request.first_seed, request.first_seed + request.seeds):
            settings = Settings(
                task=request.task,
                reward=request.reward,
                preset=request.preset or default_preset(),
                seed=seed,
                demos=None if request.demos is None else str(request.demos),
                updates=request.updates,
                encoder_steps=request.encoder_steps,
                pretrain=replace(hyper, **changes["pretrain"]),
                ppo=PPOHyper(**changes["ppo"]),
            )
            parts = [f"{name.split('.')[1]}={value:.12g}" for name, value in swept.items()]
            members.append(Member(swept, Run(request.out / ",".join([*parts, f"seed={seed}"])), settings))
    return members


def swept_values(request: Sweep) -> dict[str, tuple[float, ...]]:
    """Values by field, such as `pretrain.alpha`; see `planned` for the errors."""
    texts = list(request.sweep)
    if request.alphas is not None:
        texts.insert(0, f"pretrain.alpha={request.alphas}")
    known = [
        name
        for group, kind in _GROUPS.items()
        for name in (f"{group}.{field.name}" for field in fields(kind))
        if _matters(name, request.reward)
    ]
    values: dict[str, tuple[float, ...]] = {}
    for text in texts:
        name, _, listed = text.partition("=")
        if name not in known:
            raise ValueError(
                f"--sweep {text!r}: no field {name!r} to sweep with reward {request.reward}; "
                f"allowed: {', '.join(known)}"
            )
        if name in values:
            raise ValueError(f"--sweep {text!r}: {name} is given twice")
        try:
            values[name] = tuple(float(value) for value in listed.split(","))
        except ValueError:
            values[name] = (math.nan,)
        if not np.isfinite(values[name]).all():
            raise ValueError(f"--sweep {text!r}: {listed!r} is no list of numbers such as 0.1,1,10")
        if len({f"{value:.12g}" for value in values[name]}) < len(values[name]):
            raise ValueError(f"--sweep {text!r}: a value is given twice")
    return values


def _matters(name: str, reward: str) -> bool:
    """Whether a field changes anything: the learning rate decays over all updates, GraphIRL's mean is plain, XIRL has
    neither nodes nor a decoder.
    """
    if reward == "env" and name.startswith("pretrain."):
        return name == "pretrain.tau"
    if reward == "xirl" and name.startswith("pretrain."):
        return name.removeprefix("pretrain.") in _OF_PIXELS
    return name != "ppo.decay_updates" and not (reward.startswith("graphirl") and name == "pretrain.alpha")


def _encoders(members: Sequence[Member], task: Task, progress: Progress) -> list[dict[str, Any]]:
    """Trains and audits what encoders are missing; those that differ in PPO's floats alone share one.

    Returns:
      per member the numbers of its encoder.
    """
    demos = {member.settings.seed: _demonstrations(member, task) for member in members}
    first: dict[tuple[PretrainHyper, int], Member] = {}
    for member in members:
        first.setdefault((member.settings.pretrain, member.settings.seed), member)
    missing = [member for member in first.values() if not (member.run.path / "encoder.json").exists()]
    if missing:
        jobs = [EncoderJob(m.run, demos[m.settings.seed], m.settings.pretrain, m.settings.seed) for m in missing]
        trained = train_encoders(jobs, members[0].settings.pretraining, progress)
        for member, job, (model, numbers) in zip(missing, jobs, trained, strict=True):
            progress.note(f"auditing {member.run.path.name}")
            audited = pipeline.audit_reward(member.run, task, model, job.demonstrations, job.seed)
            runs.write_json(member.run.path / "encoder.json", numbers | audited)
    for member in members:
        owner = first[member.settings.pretrain, member.settings.seed].run.path
        for name in ("encoder.npz", "encoder.json", "demonstrations.npz"):
            _copy_missing(owner / name, member.run.path / name)
    return [{"encoder": runs.read_json(member.run.path / "encoder.json")} for member in members]


def _demonstrations(member: Member, task: Task) -> demonstrations.Demonstrations:
    """A seed's demonstrations, made once; the members of that seed have copies."""
    kept = member.run.path / "demonstrations.npz"
    for sibling in member.run.path.parent.glob(f"*seed={member.settings.seed}/demonstrations.npz"):
        _copy_missing(sibling, kept)
    if not kept.exists():
        pipeline.make_demonstrations(task, member.settings).save(kept)
    return demonstrations.load(kept)


def _copy_missing(source: Path, target: Path) -> None:
    if not target.exists():
        runs.write_atomically(target, lambda temporary: shutil.copyfile(source, temporary))


def _policies(members: Sequence[Member], task: Task, progress: Progress, folder: Path) -> list[dict[str, Any]]:
    """Trains all policies and evaluates each as `train.py` would; the outcomes per member."""
    summaries = [member.run.path / "summary.json" for member in members]
    if all(path.exists() for path in summaries):
        return [runs.read_json(path) for path in summaries]
    rewards = [pipeline.saved_reward(m.run, m.settings, task) for m in members]
    jobs = [PolicyJob(m.run, m.settings, reward) for m, reward in zip(members, rewards, strict=True)]
    trained = train_policies(jobs, task, progress, folder if len(jobs) > 1 else None)
    progress.note("evaluating")
    outcomes = []
    for member, reward, (policy, numbers) in zip(members, rewards, trained, strict=True):
        settings = member.settings
        episodes, seed = settings.sizes.episodes, settings.seed + 1000
        outcome = pipeline.evaluate_policy(task, settings, reward, policy, episodes, seed)
        outcome = {**outcome, **numbers, "training_seed": settings.seed, "reward": settings.reward}
        runs.write_json(member.run.path / "summary.json", outcome)
        outcomes.append(outcome)
    return outcomes


def _resumed(request: Sweep) -> Sweep:
    """The request that a folder's sweep was started with.

    Raises:
      RunError: the folder holds none.
    """
    config = Run(request.out).config
    if config.get("command") != "sweep" or config.get("version") != runs.VERSION:
        raise RunError(f"--resume: {request.out}/config.json is of {config.get('command')!r}; allowed: 'sweep'")
    config = {name: value for name, value in config.items() if name not in ("command", "version")}
    demos = None if config["demos"] is None else Path(config["demos"])
    return Sweep(**{**config, "out": request.out, "demos": demos, "sweep": tuple(config["sweep"]), "resume": True})


def _print(rows: Sequence[dict[str, Any]]) -> None:
    """A table of means over seeds, with intervals of success."""
    table = Table("swept", "seeds", "success", "95 % interval", *(name.replace("_", " ") for name in _AUDITED))
    for swept, same in itertools.groupby(rows, lambda row: row["swept"]):
        found = list(same)
        rates = [row["success_rate"] for row in found if "success_rate" in row]
        spread = interval(rates) if rates else None
        audits = [row["encoder"] for row in found if "encoder" in row]
        table.add_row(
            ", ".join(f"{name} {value:g}" for name, value in swept.items()) or "-",
            str(len(found)),
            f"{np.mean(rates):.1%}" if rates else "-",
            f"{spread[0]:.1%} to {spread[1]:.1%}" if spread else "-",
            *(f"{np.mean([audit[name] for audit in audits]):.3f}" if audits else "-" for name in _AUDITED),
        )
    Console(stderr=True).print(table)
