"""The content of a page: that of released runs, of one whose demonstrations are gone, and of an encoder alone."""

from pathlib import Path

import pytest

from graphrl_jax.experiment.report.content import content_of
from graphrl_jax.experiment.report.facts import read_facts


@pytest.fixture(scope="module")
def content():
    return content_of(read_facts(Path("checkpoints/shoes_in_box_graph")), "graphrl train", "")


def test_headline_numbers_have_units_and_a_meaning(content):
    told = {one.label: (one.value, one.meaning) for one in content.numbers}
    assert told["Success rate"] == ("99.6 %", "of 256 unseen episodes; 95 % interval 97.8 % to 99.9 %")
    assert told["Training"] == ("10.2 M", "environment steps in 500 of 500 updates, 4,386 per second")
    assert told["Time"] == ("43 min", "since the run was resumed, of which 1 min 7 s to compile")


def test_audit_kinds_and_subtasks_are_those_of_the_summary(content):
    audit = {one.label: one.value for one in content.audit}
    assert (audit["Random scenes in order"], audit["Order in time"], audit["Rho"]) == ("89.1 %", "0.98", "0.86")
    assert [one.name for one in content.kinds[:2]] == ["success", "shoe_held"]
    assert (content.kinds[0].below, content.kinds[1].below) == (None, 1.0)
    assert {one.label: one.value for one in content.subtask_numbers}["Found"] == "3.00"


def test_settings_are_those_that_matter(content):
    assert content.settings.keys() == {"run", "pretrain", "pretrain_config", "ppo", "ppo_config"}
    assert content.settings["ppo_config"]["policy_hidden"] == "256 256"
    assert content.settings["pretrain_config"]["encoder.kind"] == "message_passing"
    assert not [name for name in content.settings["pretrain_config"] if "pixels" in name]
    assert content.settings["run"]["demos"] == "-" and content.made_with["jax"] == "0.10.2"
    env = content_of(read_facts(Path("checkpoints/match_regions_env")), "", "")
    assert env.settings.keys() == {"run", "ppo", "ppo_config"} and not env.audit and env.held_out is None


def test_what_is_not_there_is_not_told(content):
    assert (content.video, content.landscape, content.subtasks, content.held_out) == 4 * (None,)
    assert any("no video" in sentence for sentence in content.missed)
