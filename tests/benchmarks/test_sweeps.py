"""A sweep beside its members alone."""

import jax
import pytest

from benchmarks import sweeps
from graphrl_jax.runtime import ProcessLog


class Curve:
    """Stands for a run with two log lines."""

    def __init__(self, values: list[float]) -> None:
        self.run = self
        self.values = values

    def records(self, stage: str) -> list[dict]:
        return [{"stage": stage, "loss": value} for value in self.values]


def test_a_sweep_is_compared_with_its_members_alone(monkeypatch):
    trained, cleared = [], []
    # A clock that only training moves: a second each time.
    monkeypatch.setattr(sweeps.time, "perf_counter", lambda: float(len(trained)))
    monkeypatch.setattr(jax, "clear_caches", lambda: cleared.append(len(trained)))

    def make_jobs(name: str) -> list[Curve]:
        return [Curve([4.0, 1.0]), Curve([2.0, 1.0 if name == "alone" else 1.2])]

    def train(jobs: list[Curve]) -> None:
        trained.append(len(jobs))

    found = sweeps.compared(make_jobs, train, ProcessLog(), "pretrain")
    assert trained == [2, 1, 1] and found["members"] == 2
    assert cleared == [0, 1, 2]  # every training begins with nothing compiled
    assert found["of_separate_runs"] == pytest.approx(0.5)
    assert found["largest_difference"] == pytest.approx(0.2 / 4) and found["compiling"]["alone"] == 0
