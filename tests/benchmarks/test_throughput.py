"""Throughput: rates of programs that are timed in turns, and the programs themselves."""

import os
import shlex
import subprocess
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import tyro

from benchmarks import devices, shoes_policies, throughput
from graphrl_jax.registry import make_task
from graphrl_jax.runtime import jit_physics
from graphrl_jax.storage import read_json
from tests.helpers.outside_package import REPOSITORY
from tests.helpers.shoes_in_box import TASK

RELEASED = ["match_regions_graph", "shoes_in_box_graph"]


def test_rates_are_work_over_the_median_time():
    x = jnp.ones(64)
    programs = {"physics": (jnp.sin, (x,)), "twice": (lambda x: jnp.cos(jnp.sin(x)), (x,))}
    measured = throughput.measure({"mjx": programs, "mujoco": programs}, 10, 3)
    for found in measured.values():
        seconds = {name: float(np.median(times)) for name, times in found["seconds"].items()}
        assert all(len(times) == 3 for times in found["seconds"].values())
        assert found["steps_per_second"]["twice"] == pytest.approx(10 / seconds["twice"])
        assert found["of_physics"]["twice"] == pytest.approx(seconds["physics"] / seconds["twice"])
        assert found["of_physics"]["physics"] == 1.0
    rates = {engine: found["steps_per_second"]["twice"] for engine, found in measured.items()}
    ratios = throughput.of_first(measured)
    assert ratios.keys() == {"mujoco"} and ratios["mujoco"]["twice"] == pytest.approx(rates["mujoco"] / rates["mjx"])


def test_empty_batches_and_unknown_names_are_refused():
    with pytest.raises(ValueError, match=r"num_envs is \(4, 0\); allowed: 1 or more"):
        throughput.Options(num_envs=(4, 0))
    with pytest.raises(ValueError, match="--engines 'bullet'; allowed: mjx, mujoco, warp"):
        throughput.Options(engines=("mjx", "bullet"))
    with pytest.raises(ValueError, match="--before tests has no folder graphrl_jax"):
        throughput.Options(before=Path("tests"))
    with pytest.raises(ValueError, match="--programs 'ppo'; allowed: physics, environment"):
        throughput.Options(programs=("ppo",))


@pytest.mark.parametrize("task", [TASK, make_task("match_regions")], ids=lambda task: task.name)
def test_bare_physics_moves_the_bodies_and_nothing_else(task):
    run, (states,) = throughput.physics_program(task, 2, 3, jax.random.key(0))
    after = jit_physics(run)(states)
    assert after.qpos.shape == states.qpos.shape and np.isfinite(after.qpos).all()
    assert (np.abs(after.qpos - states.qpos).max(axis=1) > 0).all()
    kept = [name for name in states._fields if name not in ("qpos", "qvel", "warmstart")]
    for name in kept:
        jax.tree.map(np.testing.assert_array_equal, getattr(after, name), getattr(states, name))


def test_earlier_sources_are_measured_alike(monkeypatch, tmp_path):
    options = throughput.Options(engines=("mujoco",), programs=("ppo_env",), num_envs=(2, 4), steps=3, repeats=5)
    found, calls = [], []

    def run(command: list[str], cwd: Path, env: dict[str, str], check: bool) -> None:
        assert env["PYTHONPATH"] == str(cwd)
        found.append({path.name: path.resolve() for path in cwd.iterdir()})
        calls.append(command)
        Path(command[command.index("--out") + 1]).write_text('{"batches": []}')

    monkeypatch.setattr(throughput.subprocess, "run", run)
    assert throughput.measured_before(tmp_path, options) == {"batches": []}
    earlier = {name: tmp_path / name for name in ("graphrl_jax", "tasks")}
    assert found == [{**earlier, "benchmarks": Path(throughput.__file__).parent}]
    ((_, _, module, *asked),) = calls
    out = asked.index("--out")
    assert module == "benchmarks.throughput"
    assert tyro.cli(throughput.Options, args=asked[:out] + asked[out + 2 :]) == options


def test_ppo_is_that_of_the_task(monkeypatch):
    monkeypatch.setattr(throughput.ppo, "init_jit", lambda *arguments: "state")
    options = throughput.Options(task="shoes_in_box", programs=("ppo_graph",), num_envs=(4,), steps=2)
    model = throughput.random_reward(TASK, jax.random.key(0))
    programs = throughput.build_programs(TASK, model, None, options, 4, jax.random.key(1))
    assert programs.keys() == {"physics", "ppo_graph"}
    update, (hyper, params, state) = programs["ppo_graph"]
    config, _ = update.args
    assert (config.num_envs, config.unroll_length, config.num_minibatches) == (4, 2, 4)
    assert config.steps_per_update == 4 * 2 * TASK.decision_steps and config.progress
    assert float(hyper.entropy_cost) == pytest.approx(0.006) and params.reward is model and state == "state"


def test_result_files_of_earlier_releases_are_drawn(tmp_path):
    batches = read_json(REPOSITORY / "benchmarks" / "results" / "throughput.json")["batches"]
    throughput.figure(batches, tmp_path / "throughput.png")
    assert (tmp_path / "throughput.png").exists()


@pytest.mark.parametrize("has_warp", [False, True])
def test_the_gpu_script_asks_for_what_there_is(tmp_path, has_warp):
    """It is run with a stand-in for Python, which notes its arguments and says whether Warp is there."""
    python, log = tmp_path / "python", tmp_path / "log"
    python.write_text(f'#!/bin/sh\n[ "$1" = -c ] && exit {int(not has_warp)}\necho "$@" >> {log}\n')
    python.chmod(0o755)
    folders = {"RUNS": str(tmp_path / "runs"), "RESULTS": str(tmp_path / "results")}
    script = REPOSITORY / "benchmarks" / "gpu.sh"
    subprocess.run([str(script)], env={"PATH": os.environ["PATH"], "PYTHON": str(python), **folders}, check=True)
    asked = [shlex.split(line) for line in log.read_text().splitlines()]
    kinds = {"throughput": throughput.Options, "devices": devices.Options, "shoes_policies": shoes_policies.Options}
    options = [
        tyro.cli(kinds[name], args=words[2:])
        for words in asked
        if (name := words[1].removeprefix("benchmarks.")) in kinds
    ]
    measured = [some for some in options if isinstance(some, throughput.Options)]
    assert {some.num_envs for some in measured} == {(1024,), (4096,), (16384,), (1024, 4096, 16384)}
    engines = {some.task: some.engines for some in measured}
    assert engines == {"match_regions": ("mjx",), "shoes_in_box": ("mjx", "warp") if has_warp else ("mjx",)}
    assert [some.model.name for some in options if isinstance(some, devices.Options)] == RELEASED
    assert [some.preset for some in options if isinstance(some, shoes_policies.Options)] == ["gpu"]
    assert ["train.py", "--preset", "gpu", "--out", str(tmp_path / "runs" / "match_regions")] in asked


def test_the_gpu_script_refuses_an_unknown_part(tmp_path):
    script, folders = REPOSITORY / "benchmarks" / "gpu.sh", {"RUNS": str(tmp_path), "RESULTS": str(tmp_path)}
    environment = {"PATH": os.environ["PATH"], "PYTHON": "true", **folders}
    done = subprocess.run([str(script), "tables"], env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 2 and "unknown part 'tables'; allowed: train rewards" in done.stderr
