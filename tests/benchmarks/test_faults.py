"""Faults on purpose, a small part of the benchmark: mutated imports, kills, random actions, comparison of results."""

import math

import numpy as np
import pytest

from benchmarks.faults import __main__ as faults
from benchmarks.faults import physics
from benchmarks.faults.fuzz import fuzz
from benchmarks.faults.kills import kill
from benchmarks.faults.mutations import mutate
from benchmarks.faults.runs import difference
from benchmarks.faults.sources import WRITERS, write_coco, write_yolo
from graphrl_jax.storage import read_json

IMAGES = np.zeros((3, 8, 8, 3), np.uint8)


def test_mutated_sources_are_imported_or_refused(tmp_path):
    found = fuzz(3 * len(WRITERS), seed=1, kept=tmp_path)
    assert not found["wrong"] and not list(tmp_path.iterdir())
    assert found["outcomes"].keys() == WRITERS.keys()
    counts = [sum(one.values()) for one in found["outcomes"].values()]
    assert counts == [3] * len(WRITERS)
    refused = sum(one.get("refused", 0) for one in found["outcomes"].values())
    assert 0 < refused < sum(counts)


def contents(folder):
    return {path.relative_to(folder): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_a_mutation_follows_from_its_seed(tmp_path):
    made = []
    for number, seed in enumerate((3, 3, 4)):
        folder = tmp_path / str(number)
        folder.mkdir()
        write_yolo(folder, IMAGES)
        write_coco(folder, IMAGES)
        before = contents(folder)
        done = mutate(folder, np.random.default_rng(seed))
        assert done and contents(folder) != before
        made.append((done, contents(folder)))
    assert made[0] == made[1] != made[2]


def test_results_differ_by_their_numbers_or_by_their_form():
    assert difference({"a": [1.0, 2.0]}, {"a": [1.0, 2.0]}) == 0
    assert difference({"a": [1.0, 2.0]}, {"a": [1.0, 4.0]}) == 0.5
    assert difference({"a": 1.0}, {"b": 1.0}) == difference([1.0], [1.0, 1.0]) == math.inf
    assert difference({"a": None}, {"a": 1.0}) == difference("x", "y") == math.inf


def test_random_actions_are_counted(monkeypatch):
    monkeypatch.setattr(physics, "NUM_ENVS", 3)
    monkeypatch.setattr(physics, "CONTROL_STEPS", 5)
    assert physics.random_steps("match_regions", 0) == {"steps": 3 * 5 * 3, "bad": 0}


def test_physics_goes_on_from_what_the_file_counts(monkeypatch, tmp_path):
    chunks = []

    def chunk(name, seed):
        chunks.append((name, seed))
        return {"steps": 10, "bad": 1}

    monkeypatch.setattr(faults, "random_steps", chunk)
    monkeypatch.setattr(faults, "task_names", lambda: ["match_regions", "shoes_in_box", "carry"])
    out = tmp_path / "faults.json"
    for steps in (20, 60):
        options = faults.Options(parts=("physics",), steps=steps, out=out)
        report = read_json(out) if out.exists() else {}
        found = faults.PARTS["physics"](options, report, tmp_path)
        assert (found["steps"], found["bad"]) == (steps, steps // 10)
    assert chunks == [
        (name, seed) for seeds in ([0], [1, 2]) for name in ("match_regions", "shoes_in_box") for seed in seeds
    ]


def test_parts_are_known():
    with pytest.raises(ValueError, match="--parts 'flood'; allowed: kills, disks, fuzz, physics"):
        faults.Options(parts=("flood",))


@pytest.mark.slow
def test_a_killed_run_ends_with_the_numbers_of_one_that_was_not(tmp_path):
    found = kill("train", tmp_path, kills=2, kills_per_run=2, draw=np.random.default_rng(0))
    assert found["largest_difference"] < 1e-6 and not found["unexpected"] and len(found["moments_s"]) == 2
