"""Training of encoders and fitting of their rewards, for one run or for a sweep's members side by side."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Any, NamedTuple

import jax
import numpy as np

from graphrl_jax.demonstrations import Demonstrations, drawn_share
from graphrl_jax.experiment import batching, sharding
from graphrl_jax.experiment.keys import RunStage, stage_key
from graphrl_jax.experiment.run_directory import Run
from graphrl_jax.pretrain import tcc, trainer
from graphrl_jax.pretrain.config import PretrainConfig, PretrainHyper
from graphrl_jax.pretrain.trainer import DrawBoxes, PretrainData, PretrainState
from graphrl_jax.progress import Progress
from graphrl_jax.reward.alignment import cycle_consistency, kendall_tau, value_order_correlation
from graphrl_jax.reward.card import Card
from graphrl_jax.reward.model import (
    RewardModel,
    demonstration_embeddings,
    demonstration_rewards,
    fit_reward,
    save_parameters,
)
from graphrl_jax.rl.ppo import as_float32

ENDS_SHARE, END_MARGIN = 0.95, 0.1
"""A recording looks like success if its reward ends above that of this share of the successes, less this margin. Those
held out count as well: they tell how recordings end that the encoder has not seen."""
AS_ONE_POINT = 0.95
"""An encoder whose last TCC is above this share of that of one point has learned nothing."""
FITTED_SHARE = 0.75
"""Share of the successes that an encoder is trained on; the rest is held out."""


@dataclass(frozen=True)
class EncoderJob:
    """An encoder to train, and the run folder for its parameters and log lines.

    `draw` draws rearranged demonstrations for an encoder of images that learns from them.
    """

    run: Run
    demonstrations: Demonstrations
    hyper: PretrainHyper
    seed: int
    draw: DrawBoxes | None = None

    @cached_property
    def _fitted(self) -> np.ndarray:
        """Which demonstrations the encoder is trained on: (B,) bool."""
        fitted = self.demonstrations.success.copy()
        fitted[fitted] = drawn_share(int(fitted.sum()), FITTED_SHARE, self.seed)
        return fitted

    @cached_property
    def split(self) -> tuple[Demonstrations, Demonstrations]:
        """Successes for training, and held-out successes."""
        return self.demonstrations.select(self._fitted), self.unseen.successes()

    @cached_property
    def unseen(self) -> Demonstrations:
        """All that the encoder is not trained on: held-out successes and all failures."""
        return self.demonstrations.select(~self._fitted)


class _Inputs(NamedTuple):
    """Inputs of the training program of one encoder."""

    hyper: PretrainHyper
    data: PretrainData
    state: PretrainState


def train_encoders(
    jobs: Sequence[EncoderJob], config: PretrainConfig, progress: Progress
) -> list[tuple[RewardModel, dict[str, Any]]]:
    """Pretrains encoders on three quarters of the successes and fits their rewards; writes the parameters of each.

    Returns:
      Per job its reward model, and its metrics on the held-out quarter (see `encoder_metrics`); and pretrain_s, the
      seconds of all optimiser steps of all jobs, compilation included.

    Raises:
      ValueError: the jobs' demonstrations differ in number or length.
    """
    for source in dict.fromkeys(job.demonstrations.source for job in jobs):
        progress.note(f"demonstrations: {source}")
    # One program serves all of them, those that need no drawings as well.
    draw = next((job.draw for job in jobs if job.draw is not None), None)
    inputs = [_inputs(job, config, draw) for job in jobs]
    shapes = {(jax.tree.structure(one.data), one.data.mask.shape) for one in inputs}
    if len(shapes) > 1:
        raise ValueError(f"demonstrations trained on side by side must agree in number and length, got {shapes}")
    for job in jobs:
        job.run.forget_after("pretrain", "step", 0)
    started = time.perf_counter()
    states = _optimise_all(jobs, config, inputs, progress)
    seconds = time.perf_counter() - started
    trained = []
    for job, one, state in zip(jobs, inputs, states, strict=True):
        if job.hyper.tcc_weight:
            _warn_of_one_point(job, config, progress)
        model = _fit_reward(job, config, one.data, state)
        trained.append((model, {**encoder_metrics(model, job.split[1]), "pretrain_s": seconds}))
    return trained


def _warn_of_one_point(job: EncoderJob, config: PretrainConfig, progress: Progress) -> None:
    """Says so if an encoder ended where all frames are one point, for then its reward means nothing."""
    (*_, last) = job.run.records("pretrain")
    least = float(tcc.loss_of_one_point(config.num_frames, config.tcc_loss))
    if last["tcc"] > AS_ONE_POINT * least:
        progress.note(
            f"warning: {job.run.path.name} maps all frames to nearly one point, so its reward means nothing: its TCC is"
            f" {last['tcc']:.4f}, that of one point {least:.4f}; try a smaller --pretrain.temperature, more"
            " --pretrain.steps or other demonstrations"
        )


def _inputs(job: EncoderJob, config: PretrainConfig, draw: DrawBoxes | None) -> _Inputs:
    data = trainer.prepare(job.split[0], config.encoder.image_size, draw)
    state = trainer.init(config, data.objects, stage_key(job.seed, RunStage.PRETRAIN))
    return _Inputs(as_float32(job.hyper), data, state)


def _optimise_all(
    jobs: Sequence[EncoderJob], config: PretrainConfig, inputs: Sequence[_Inputs], progress: Progress
) -> list[PretrainState]:
    """Makes all steps of all jobs, in groups that fit into memory; returns the final states."""

    @cache
    def program_for(steps: int, count: int) -> Any:
        program = batching.pretrain_program(config, steps, count)
        (members,) = batching.groups(inputs[:count], count)
        return program.lower(*batching.stack(members)).compile()

    chunk = max(1, config.steps // 10)
    fitting, _ = batching.fit(lambda count: program_for(chunk, batching.spread(count)), len(jobs))
    size = batching.spread(fitting)
    groups = batching.groups(range(len(jobs)), size)
    progress.begin("pretraining", config.steps * len(groups))
    if len(jobs) > 1:
        progress.note(f"{len(jobs)} encoders, {size} side by side")
    states: dict[int, PretrainState] = {}
    for group in groups:
        stacked = batching.stack([inputs[i] for i in group])
        trained = _optimise(stacked, config, chunk, size, program_for, _logger(jobs, group, progress))
        states |= dict(batching.each_once(group, trained))
    return [states[i] for i in range(len(jobs))]


def _optimise(
    stacked: _Inputs,
    config: PretrainConfig,
    chunk: int,
    size: int,
    program_for: Callable[[int, int], Any],
    log: Callable[[int, int, list[dict[str, Any]]], None],
) -> list[PretrainState]:
    """Makes all steps of a group, `chunk` at a time; `log` gets steps done, steps of the chunk, and members' means."""
    lies = sharding.per_member(sharding.mesh_for(size, len(jax.devices())), size)
    hyper, data, state = sharding.put(stacked, lies)
    for done in range(0, config.steps, chunk):
        steps = min(chunk, config.steps - done)
        state, history = program_for(steps, size)(hyper, data, state)
        means = jax.tree.map(lambda values: values.mean(-1), sharding.to_host(history))
        log(done + steps, steps, batching.unstack(means, size))
    return batching.unstack(sharding.to_host(state), size)


def _logger(
    jobs: Sequence[EncoderJob], group: Sequence[int], progress: Progress
) -> Callable[[int, int, list[dict[str, Any]]], None]:
    """The function that writes a log line per member and advances the progress."""

    def log(done: int, steps: int, means: list[dict[str, Any]]) -> None:
        for i, record in batching.each_once(group, means):
            metrics = {name: float(value) for name, value in record.items()}
            jobs[i].run.log({"stage": "pretrain", "step": done, **metrics})
        progress.advance(steps, loss=float(np.mean([record["loss"] for record in means])))

    return log


def _fit_reward(job: EncoderJob, config: PretrainConfig, data: PretrainData, state: PretrainState) -> RewardModel:
    """Fits and saves the reward of a trained encoder."""
    shown = trainer.shown_frames(config, as_float32(job.hyper), data, stage_key(job.seed, RunStage.GOAL))
    pooling = trainer.pooling_params(config, job.hyper)
    image_size = config.encoder.image_size
    params, hyper = state.params["encoder"], job.hyper
    model = fit_reward(params, job.split[0], pooling, shown, hyper.even, hyper.exponent, image_size)
    save_parameters(job.run.path, model)
    return replace(model, card=_card(job, config, model))


def _card(job: EncoderJob, config: PretrainConfig, model: RewardModel) -> Card:
    """The card of a trained model."""
    demos, successes = job.split[0], job.demonstrations.successes()
    ends = np.asarray(demonstration_rewards(model, successes))[np.arange(len(successes)), successes.lengths - 1]
    end_reward = float(np.quantile(ends, 1 - ENDS_SHARE)) - END_MARGIN
    return Card(
        objects=demos.objects,
        frame_rate=demos.frame_rate,
        encoder=config.encoder,
        activity=config.activity,
        task=demos.task,
        source=demos.source,
        demonstrations=len(demos),
        end_reward=end_reward,
    )


def encoder_metrics(model: RewardModel, held_out: Demonstrations) -> dict[str, float]:
    """Value-order correlation, and Kendall's tau of two demonstrations or more, cycle consistency of three or more."""
    embeddings = demonstration_embeddings(model, held_out)
    rewards = demonstration_rewards(model, held_out)
    lengths = held_out.lengths
    metrics = {"value_order_correlation": float(np.mean(value_order_correlation(rewards, lengths)))}
    if len(held_out) >= 2:
        metrics["kendall_tau"] = kendall_tau(embeddings, lengths)
    if len(held_out) >= 3:
        metrics["cycle_consistency"] = cycle_consistency(embeddings, lengths)
    return metrics
