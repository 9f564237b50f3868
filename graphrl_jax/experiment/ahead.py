"""Compilation ahead: the programs of a policy are compiled while its encoder is trained.

XLA compiles without Python's lock, so a second core does it. What JAX has compiled for some shapes and dtypes serves
all later calls with the same ones.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import cache
from threading import Event, Thread
from typing import Any

from graphrl_jax.experiment.checkpoints import TrainedRun, policy_shapes
from graphrl_jax.experiment.evaluation import compile_evaluation, compile_recording
from graphrl_jax.experiment.policy_programs import PolicyPrograms
from graphrl_jax.experiment.settings import Settings
from graphrl_jax.task import Task

Compile = Callable[[], Any]


@contextmanager
def compiling(programs: Sequence[Compile]) -> Iterator[None]:
    """Compiles programs one after the other on a thread of its own, none any more once the block ends.

    A program that fails is left to those who need it, where it fails again.
    """
    ended = Event()

    def work() -> None:
        for compile_one in programs:
            if ended.is_set():
                return
            with suppress(Exception):
                compile_one()

    Thread(target=work, name="compilation ahead").start()
    try:
        yield
    finally:
        ended.set()


def programs_of(
    settings: Settings, task: Task, reward: Any, programs: PolicyPrograms, video_episodes: int
) -> list[Compile]:
    """What a single run compiles after its encoder, in the order in which it is needed.

    Args:
      settings: of the run.
      task: of the run.
      reward: reward parameters, or the shapes and dtypes of their leaves.
      programs: those of the training.
      video_episodes: episodes of the video; 0 for none.
    """

    @cache
    def shapes() -> TrainedRun:
        return TrainedRun(task, settings, reward, policy_shapes(task, settings, reward))

    found: list[Compile] = [programs.compile, lambda: compile_evaluation(shapes(), settings.episodes)]
    return [*found, lambda: compile_recording(shapes(), video_episodes)] if video_episodes else found
