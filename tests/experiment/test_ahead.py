"""Compilation ahead: programs are compiled beside the encoder, once."""

import re
from threading import Event

import jax
import pytest

from graphrl_jax import cli
from graphrl_jax.experiment.ahead import compiling
from tests.helpers.commands import call

RUN = ("--task", "carry", "--preset", "smoke", "--ppo.num-envs", 8, "--seed", 4)


def test_programs_are_compiled_in_order_and_one_that_fails_stops_none():
    done, all_done = [], Event()

    def fail() -> None:
        done.append("failed")
        raise ValueError("no such program")

    with compiling([lambda: done.append("first"), fail, lambda: (done.append("last"), all_done.set())]):
        assert all_done.wait(10)
    assert done == ["first", "failed", "last"]


def test_none_is_begun_after_the_end():
    begun, ended, done = Event(), Event(), Event()

    def slow() -> None:
        begun.set()
        ended.wait(10)
        done.set()

    late = []
    with pytest.raises(KeyboardInterrupt), compiling([slow, lambda: late.append(1)]):
        assert begun.wait(10)
        raise KeyboardInterrupt
    ended.set()
    assert done.wait(10) and not late


def test_a_run_compiles_each_of_its_programs_once(tmp_path, outside_package, caplog):
    jax.config.update("jax_log_compiles", True)
    try:
        call(cli.train_main, *RUN, "--out", tmp_path / "run")
    finally:
        jax.config.update("jax_log_compiles", False)
    found = re.findall(r"Finished XLA compilation of jit\((\w+)\)", caplog.text)
    assert [found.count(program) for program in ("episode_outcomes", "record_frames")] == [1, 1]
