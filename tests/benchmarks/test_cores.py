"""What training costs against its scale."""

import sys

import pytest

from benchmarks import cores
from graphrl_jax.storage import read_json

RATES = {"physics": 1e6 / 4, "environment": 1e6 / 5, "reward": 1e6 / 8, "policy": 1e6 / 9, "ppo_graph": 1e6 / 12}


def test_the_parts_of_an_update_add_up_to_it():
    parts = cores.microseconds_of_parts(RATES)
    assert list(parts.values()) == pytest.approx([4, 1, 3, 1, 3])
    assert cores.on_paper(parts, 1) == pytest.approx(RATES["ppo_graph"])
    # Physics takes 4 of 12 microseconds, and half of that on two cores.
    assert cores.on_paper(parts, 2) == pytest.approx(1e6 / 10)
    assert cores.on_paper(parts, 10**6) == pytest.approx(1e6 / 8, rel=1e-4)


def test_the_report_has_every_scale(tmp_path, monkeypatch):
    batch = {"num_envs": 64, "engines": {"mujoco": {"steps_per_second": RATES, "memory_mib": {"ppo_graph": 7.0}}}}
    monkeypatch.setattr(cores, "throughput_on", lambda count, options: [batch])
    monkeypatch.setattr(cores, "side_by_side", lambda options: {"1": 10.0, "2": 20.0})
    monkeypatch.setattr(sys, "argv", ["cores", "--cores", "1", "--out", str(tmp_path / "cores.json")])
    cores.main()
    found = read_json(tmp_path / "cores.json")
    assert found["cores"]["1"][0]["microseconds"]["gradient steps"] == pytest.approx(3)
    assert found["on_paper"]["1"] == pytest.approx(RATES["ppo_graph"]) and found["members"] == {"1": 10.0, "2": 20.0}
    assert (tmp_path / "cores.png").exists()


def test_cores_that_are_not_there_are_refused():
    with pytest.raises(ValueError, match=r"cores is \(1, 4096\); allowed: 1, and others up to"):
        cores.Options(cores=(1, 4096))
    with pytest.raises(ValueError, match=r"cores is \(2,\); allowed: 1, and others"):
        cores.Options(cores=(2,))
