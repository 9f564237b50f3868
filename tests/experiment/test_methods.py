"""The table of rewards: every row makes a run, and what a row does not know is an error."""

import pytest

from graphrl_jax.experiment.methods import ABLATIONS, ALL_FLOATS, METHODS, method_named
from graphrl_jax.experiment.presets import PRESETS
from graphrl_jax.experiment.settings import compose
from graphrl_jax.registry import make_task
from graphrl_jax.rl.wrappers import WRAPPERS

TASK = make_task("match_regions")
WITHOUT_EFFECT = [(name, field) for name, row in METHODS.items() for field in ALL_FLOATS if field not in row.floats]


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("name", METHODS)
def test_every_row_composes(name, preset):
    method, settings = METHODS[name], compose(TASK, name, preset)
    assert settings.method is method and method.needs in WRAPPERS
    assert settings.ppo_config.episode_length == TASK.episode_length
    for field, value in method.overrides.items():
        assert getattr(settings.pretrain, field) == value
    if method.encoder is not None:
        sizes = PRESETS[preset].pretrain_config[method.needs]
        assert settings.pretrain_config.encoder.kind == method.encoder
        assert (settings.pretrain_config.steps, settings.image_size is None) == (sizes.steps, method.needs == "graphs")


@pytest.mark.parametrize("name", METHODS)
def test_every_row_takes_the_floats_and_ablations_that_it_knows(name):
    method = METHODS[name]
    for field in method.floats:
        # A float that something else switches off is refused.
        others = {"even": 0.0, "rearranged": 1.0}
        beside = {name: value for name, value in others.items() if name in method.floats}
        assert getattr(compose(TASK, name, pretrain={**beside, field: 0.625}).pretrain, field) == 0.625
    for ablation in method.ablations:
        found = compose(TASK, name, ablations=(ablation,))
        assert found != compose(TASK, name)
        for field, value in ABLATIONS[ablation].floats.items():
            assert getattr(found.pretrain, field) == value


@pytest.mark.parametrize("find", [method_named, lambda name: compose(TASK, name)])
def test_a_name_that_is_not_in_the_table_is_an_error_that_lists_the_rows(find):
    with pytest.raises(ValueError, match="unknown reward 'gaph'; known rewards: " + ", ".join(METHODS)):
        find("gaph")


@pytest.mark.parametrize("name, field", WITHOUT_EFFECT)
def test_a_float_that_changes_nothing_about_a_method_is_an_error(name, field):
    allowed = ", ".join(METHODS[name].floats)
    with pytest.raises(ValueError, match=f"pretrain.{field} changes nothing about reward {name}; allowed: {allowed}$"):
        compose(TASK, name, pretrain={field: 0.5})


@pytest.mark.parametrize("name", METHODS)
def test_an_ablation_that_changes_nothing_about_a_method_is_an_error(name):
    for ablation in ABLATIONS.keys() - set(METHODS[name].ablations):
        with pytest.raises(ValueError, match=f"ablation '{ablation}' changes nothing about reward '{name}'"):
            compose(TASK, name, ablations=(ablation,))
