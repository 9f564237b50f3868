"""Reward models on the hub, which is a folder here; what it is asked is what the real package takes."""

import inspect
from dataclasses import replace

import numpy as np
import pytest
import yaml

from graphrl_jax.reward.hub import FILES, on_hub
from graphrl_jax.reward.model import RewardModel
from tests.helpers import hub as stand_in
from tests.helpers.hub import Hub
from tests.helpers.reward_models import small_model


@pytest.fixture(scope="module")
def model() -> RewardModel:
    return small_model()


@pytest.fixture
def hub(monkeypatch, tmp_path) -> Hub:
    """The hub, seen from an empty folder."""
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    return stand_in.put_in_place(monkeypatch, tmp_path / "hub")


def assert_same(found: RewardModel, model: RewardModel) -> None:
    assert found.card == model.card
    np.testing.assert_array_equal(found.goal, model.goal)


def test_a_model_goes_to_the_hub_and_comes_back(hub, model):
    assert model.push_to_hub("someone/sorting", {"pair_accuracy": 0.5}) == "https://huggingface.co/someone/sorting"
    assert_same(RewardModel.load("someone/sorting"), model)
    stored = {path.name: path for path in (hub.folder / "someone/sorting/main").iterdir()}
    assert stored.keys() == set(FILES)
    head, text = stored["README.md"].read_text().removeprefix("---\n").split("\n---\n", 1)
    about = yaml.safe_load(head)
    assert about["library_name"] == "graphrl_jax" and "reward-model" in about["tags"]
    assert "# Reward model for sorting" in text and "| pair_accuracy | 0.5 |" in text
    assert hub.calls == [{"repo_id": "someone/sorting", "private": None}]
    model.push_to_hub("someone/sorting", private=True)  # again
    assert hub.calls[-1]["private"] is True


def test_only_the_three_files_are_downloaded(hub, model):
    model.push_to_hub("someone/sorting")
    (hub.folder / "someone/sorting/main/policy.npz").write_bytes(b"large")
    RewardModel.load("someone/sorting")
    assert {path.name for path in (hub.folder / "cache/someone/sorting").iterdir()} == set(FILES)


def test_a_revision_is_another_state_of_the_model(hub, model):
    other = replace(model, goal=model.goal + 1)
    model.push_to_hub("someone/sorting")
    (hub.folder / "someone/sorting/next").mkdir()
    other.push_to_hub("someone/sorting", revision="next")
    assert_same(RewardModel.load("someone/sorting"), model)
    assert_same(RewardModel.load("someone/sorting", revision="next"), other)
    with pytest.raises(ValueError, match="from the hub: someone/sorting has no revision 'last'$"):
        RewardModel.load("someone/sorting", revision="last")


def test_a_folder_of_the_same_name_wins(hub, model, tmp_path):
    other = replace(model, goal=model.goal + 1)
    model.push_to_hub("someone/sorting")
    other.save(tmp_path / "here/someone/sorting")
    assert_same(RewardModel.load("someone/sorting"), other)
    with pytest.raises(ValueError, match="the revision 'next' is asked for, but someone/sorting names no model"):
        RewardModel.load("someone/sorting", revision="next")


def test_names_that_the_hub_knows_no_models_by_are_paths(hub):
    assert on_hub("someone/sorting-v1.2")
    for name in ("sorting", "a/b/c", "/someone/sorting", "../sorting", "someone/"):
        assert not on_hub(name), name


def test_what_the_hub_does_not_do_is_one_sentence(hub, model):
    refused = "^someone/sorting is no folder here, and cannot be loaded from the hub: "
    with pytest.raises(ValueError, match=f"{refused}it has no someone/sorting, or shows it only to others"):
        RewardModel.load("someone/sorting")
    hub.fault = RuntimeError("no\n  network")
    with pytest.raises(ValueError, match=f"{refused}no network$"):
        RewardModel.load("someone/sorting")
    with pytest.raises(ValueError, match="^someone/sorting cannot be written to the hub: no network$"):
        model.push_to_hub("someone/sorting")
    with pytest.raises(ValueError, match="the name of a model on the hub is 'sorting'; allowed: owner/name"):
        model.push_to_hub("sorting")
    with pytest.raises(ValueError, match="without card cannot be saved"):
        replace(model, card=None).push_to_hub("someone/sorting")
    assert not (hub.folder / "someone").exists()


def test_without_the_package_the_extra_is_named(hub, model, monkeypatch):
    stand_in.take_away(monkeypatch)
    message = r"need the package huggingface_hub: pip install \"graphrl_jax\[hub\]\"$"
    with pytest.raises(ValueError, match=f"^someone/sorting is no folder here, and models of the hub {message}"):
        RewardModel.load("someone/sorting")
    with pytest.raises(ValueError, match=f"^models on the hub {message}"):
        model.push_to_hub("someone/sorting")


@pytest.mark.parametrize("name", ["create_repo", "upload_folder", "snapshot_download"])
def test_the_package_takes_what_it_is_given(name):
    package = pytest.importorskip("huggingface_hub")
    real = inspect.signature(getattr(package, name)).parameters
    _, *used = inspect.signature(getattr(Hub, name)).parameters.values()
    for one in used:
        assert real[one.name].default == one.default, one.name
        assert real[one.name].kind in (one.kind, inspect.Parameter.POSITIONAL_OR_KEYWORD), one.name


def test_the_package_has_the_errors_that_are_told_apart():
    errors = pytest.importorskip("huggingface_hub.errors")
    for name in ("RepositoryNotFoundError", "RevisionNotFoundError"):
        assert issubclass(getattr(errors, name), OSError)
