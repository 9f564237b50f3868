"""Training on eight devices, and in two processes, is training on one: the same numbers up to rounding."""

import itertools
import json
import os
import socket
import subprocess
import sys
from pathlib import Path
from typing import Any

import jax
import numpy as np
import pytest
from safetensors.numpy import load_file

from graphrl_jax.experiment import batching, sharding
from tests.helpers.commands import TRAIN
from tests.helpers.probe_training import curves

pytestmark = pytest.mark.usefixtures("outside_package")
RUN = "import sys; from graphrl_jax import cli; cli.train_main(sys.argv[1:])"
SWEEP = "import sys; from graphrl_jax import cli; cli.main(sys.argv[1:])"
PROBES = "import json; from tests.helpers.probe_training import curves; print(json.dumps(curves(2)))"

# Shares an array out over the devices of both processes and fetches it back; then says a number of its own.
SHARED = """
import json, sys
import jax, numpy as np
from graphrl_jax.experiment import sharding
coordinator, process = sys.argv[1], int(sys.argv[2])
sharding.join(coordinator, 2, process)
lies = sharding.per_member(sharding.mesh_for(2, 8), 2)
made = {"numbers": np.arange(8.0).reshape(2, 4), "keys": jax.random.split(jax.random.key(0), 2)}
shared = sharding.put(made, lies)
fetched = sharding.to_host({**shared, "numbers": jax.jit(lambda x: 2 * x)(shared["numbers"])})
keys = jax.random.key_data(fetched["keys"]) == jax.random.key_data(made["keys"])
try:
    sharding.agreed(process, "the number")
except ValueError as error:
    refused = str(error)
print(json.dumps([fetched["numbers"].tolist(), bool(keys.all()), sharding.agreed(3, "the number"), refused]))
"""


def start(program: str, *arguments: object, number: int) -> subprocess.Popen:
    """A process with so many CPU devices."""
    environment = {
        **os.environ,
        "XLA_FLAGS": f"{os.environ.get('XLA_FLAGS', '')} --xla_force_host_platform_device_count={number}",
    }
    command = [sys.executable, "-c", program, *map(str, arguments)]
    return subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def finish(process: subprocess.Popen) -> Any:
    """What the JSON line says that a process ends with."""
    out, error = process.communicate(timeout=500)
    assert process.returncode == 0, error
    return json.loads(out.splitlines()[-1])


def curve(run: Path) -> np.ndarray:
    """What PPO logged that does not depend on the clock: (chunks, numbers)."""
    lines = [json.loads(line) for line in (run / "metrics.jsonl").read_text().splitlines()]
    numbers = [
        {name: value for name, value in line.items() if name not in ("stage", "steps_per_s")}
        for line in lines
        if line["stage"] == "ppo"
    ]
    assert numbers and len({tuple(sorted(row)) for row in numbers}) == 1
    return np.array([[row[name] for name in sorted(row)] for row in numbers])


def test_members_and_environments_on_eight_devices_give_the_numbers_of_one():
    spread = finish(start(PROBES, number=8))
    for name, values in curves(2).items():
        np.testing.assert_allclose(spread[name], values, rtol=2e-3, atol=2e-3, err_msg=name)


def test_two_processes_share_arrays_and_have_to_agree():
    address = free_address()
    running = [start(SHARED, address, process, number=2) for process in range(2)]
    refused = "the number differs between processes: [0, 1]; copy the first one's folder to the others"
    expected = [(2 * np.arange(8.0).reshape(2, 4)).tolist(), True, 3, refused]
    assert [finish(process) for process in running] == [expected, expected]


@pytest.fixture(scope="module")
def alone(outside_package, tmp_path_factory) -> Path:
    """A run on one device, with the environment's reward: nothing but PPO is spread out."""
    out = tmp_path_factory.mktemp("runs") / "alone"
    finish(start(RUN, *TRAIN, "--reward", "env", "--out", out, number=1))
    return out


@pytest.mark.slow
def test_eight_devices_give_the_numbers_of_one(tmp_path, alone):
    out = tmp_path / "eight"
    finish(start(RUN, *TRAIN, "--reward", "env", "--out", out, number=8))
    np.testing.assert_allclose(curve(out), curve(alone), rtol=2e-3, atol=2e-3)


def free_address() -> str:
    """One that nobody listens at."""
    with socket.socket() as free:
        free.bind(("localhost", 0))
        return f"localhost:{free.getsockname()[1]}"


def together(*arguments: object) -> list[dict]:
    """The same command in two processes of two devices each."""
    address = free_address()
    where = ["--coordinator", address, "--processes", 2, "--process"]
    running = [start(RUN, *arguments, *where, process, number=2) for process in range(2)]
    return [finish(process) for process in running]


@pytest.mark.slow
def test_two_processes_give_the_numbers_of_one(tmp_path, alone):
    outcomes = together(*TRAIN, "--reward", "env", "--out", tmp_path / "two")
    assert outcomes[0]["success_rate"] == outcomes[1]["success_rate"]
    for run in (tmp_path / "two", tmp_path / "two.process_1"):
        np.testing.assert_allclose(curve(run), curve(alone), rtol=2e-3, atol=2e-3)


@pytest.mark.slow
def test_two_processes_learn_a_reward_together_and_go_on(tmp_path):
    outcomes = together(*TRAIN, "--out", tmp_path / "two")
    first, second = tmp_path / "two", tmp_path / "two.process_1"
    np.testing.assert_allclose(curve(first), curve(second), rtol=1e-5)
    assert (first / "model.safetensors").stat().st_size == (second / "model.safetensors").stat().st_size
    again = together("--out", first, "--resume")
    assert [row["mean_return"] for row in again] == [row["mean_return"] for row in outcomes]


@pytest.mark.slow
def test_a_sweep_spreads_its_members_over_devices(tmp_path):
    runs = {}
    for number in (1, 8):
        out = tmp_path / str(number)
        values = ["--reward", "env", "--sweep", "ppo.learning_rate=1e-3,3e-3", "--seeds", 2]
        finish(start(SWEEP, "sweep", *TRAIN, *values, "--out", out, number=number))
        runs[number] = [curve(path.parent) for path in sorted(out.glob("*/metrics.jsonl"))]
    assert len(runs[1]) == len(runs[8]) == 4
    np.testing.assert_allclose(runs[8], runs[1], rtol=2e-3, atol=2e-3)


@pytest.mark.slow
def test_five_encoders_share_four_devices(tmp_path):
    """After four steps. Where a gradient is close to 0, Adam makes whole steps of its rounding, so that after forty the
    same encoders on one device and on four have little in common."""
    encoders = {}
    for number in (1, 4):
        out = tmp_path / str(number)
        sizes = ["--preset", "smoke", "--seeds", 5, "--encoder-steps", 4]
        finish(start(SWEEP, "sweep", "--task", "carry", *sizes, "--encoders-only", "--out", out, number=number))
        encoders[number] = [load_file(path) for path in sorted(out.glob("*/model.safetensors"))]
    alone, shared = encoders[1], encoders[4]
    assert len(alone) == len(shared) == 5
    between = [distance(one, other) for one, other in itertools.combinations(alone, 2)]
    assert min(between) > 0.5
    assert max(map(distance, alone, shared)) < 0.01


def distance(one: dict[str, np.ndarray], other: dict[str, np.ndarray]) -> float:
    """Norm of the difference of all parameters, relative to the norm of the first's."""
    assert one.keys() == other.keys()
    ours, theirs = (np.concatenate([encoder[name].ravel() for name in one]) for encoder in (one, other))
    return float(np.linalg.norm(ours - theirs) / np.linalg.norm(ours))


def test_encoders_are_padded_so_that_devices_share_them(monkeypatch):
    assert [batching.spread(count) for count in (1, 2, 5)] == [1, 2, 5]
    monkeypatch.setattr(jax, "devices", lambda: list(range(4)))
    assert [batching.spread(count) for count in (1, 2, 4, 5)] == [1, 4, 4, 8]


def test_environments_have_to_be_shared_out_evenly(monkeypatch):
    monkeypatch.setattr(jax, "devices", lambda: list(range(8)))
    monkeypatch.setattr(sharding, "Mesh", lambda grid, names: dict(zip(names, grid.shape, strict=True)))
    assert sharding.mesh_for(12, 64) == {"members": 4, "environments": 2}
    assert sharding.mesh_for(1, 64) == {"members": 1, "environments": 8}
    with pytest.raises(ValueError, match="num_envs is 60; allowed on 8 devices: multiples of 8"):
        sharding.mesh_for(1, 60)
    with pytest.raises(ValueError, match="--process is 2; allowed: 0 to 1"):
        sharding.join("localhost:1", 2, 2)
