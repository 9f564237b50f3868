"""Settings: what goes over what, and that JSON keeps all of them."""

import copy
import json
import math
from dataclasses import asdict, replace

import pytest

from graphrl_jax.experiment.methods import ABLATIONS, METHODS
from graphrl_jax.experiment.presets import PRESETS
from graphrl_jax.experiment.settings import as_json, compose, from_json
from graphrl_jax.pretrain.config import PretrainHyper
from graphrl_jax.registry import make_task
from graphrl_jax.rl.config import PPOHyper
from graphrl_jax.task import TrainingSize

pytestmark = pytest.mark.usefixtures("outside_package")


@pytest.fixture(scope="module")
def carry(outside_package):
    return make_task("carry")


def test_discounts_are_per_decision_and_can_be_had_per_control_step():
    settings = compose(make_task("shoes_in_box"), ppo={"discount": 0.5, "decision_steps": 4})
    assert settings.step_discount**4 == pytest.approx(0.5)
    assert compose(make_task("match_regions"), ppo={"discount": 0.9}).step_discount == 0.9


def test_settings_say_what_is_left_out(carry):
    graphirl = compose(carry, "graphirl").pretrain
    assert (graphirl.alpha, graphirl.reconstruction_weight) == (1, 0)
    assert (graphirl.suppress_robot, graphirl.robot_messages) == (1, 0)
    with_robot = compose(carry, "graphirl_with_robot").pretrain
    assert (with_robot.suppress_robot, with_robot.robot_messages, with_robot.alpha) == (0, 1, 1)
    ablated = compose(carry, "graph", ablations=("activity", "reconstruction")).pretrain
    assert (ablated.alpha, ablated.reconstruction_weight, ablated.suppress_robot) == (1, 0, 1)
    assert compose(carry, "graphirl").pretrain_config.encoder.kind == "interaction"
    assert not compose(carry, ablations=("edges",)).pretrain_config.encoder.edges
    for ablation, rule in (("edges", "displacement"), ("displacement", "frame_motion"), ("persistence", "momentary")):
        settings = compose(carry, ablations=(ablation,))
        assert settings.pretrain_config.activity == rule
        assert settings.pretrain.tau == (PretrainHyper().tau if rule == "displacement" else 0.02)
    with pytest.raises(ValueError, match="ablations persistence, displacement each set the rule of activity"):
        compose(carry, ablations=("persistence", "edges", "displacement"))
    assert compose(carry, pretrain={"tcc_loss": "classification"}).pretrain_config.tcc_loss == "classification"
    with pytest.raises(ValueError, match=f"'robot'; known ablations: {', '.join(ABLATIONS)}$"):
        compose(carry, ablations=("robot",))
    with pytest.raises(ValueError, match="ablation 'edges' changes nothing about reward 'graphirl'"):
        compose(carry, "graphirl", ablations=("edges",))
    with pytest.raises(ValueError, match="tcc_loss is 'x'; allowed: regression_mse"):
        compose(carry, pretrain={"tcc_loss": "x"})
    with pytest.raises(ValueError, match="activity is 'x'; allowed: displacement, frame_motion, momentary"):
        compose(carry, pretrain={"activity": "x"})


def test_what_is_asked_for_goes_over_the_method_over_the_task_over_the_preset():
    shoes = make_task("shoes_in_box")
    assert compose(shoes, "graph").pretrain.robot_messages == 0.0  # the task's
    assert compose(shoes, "graph_with_robot").pretrain.robot_messages == 1.0  # the method's
    asked = {"robot_messages": 0.5, "num_frames": 11}
    settings = compose(shoes, "graph_with_robot", "smoke", pretrain=asked, ppo={"episode_length": 8, "clip": 0.1})
    assert (settings.pretrain.robot_messages, settings.pretrain.approach) == (0.5, shoes.pretrain_overrides["approach"])
    assert (settings.pretrain_config.num_frames, settings.pretrain_config.steps) == (11, 40)
    assert (settings.ppo_config.episode_length, settings.ppo.clip, settings.ppo.decay_updates) == (8, 0.1, 4.0)
    assert compose(shoes, preset="smoke").ppo_config.episode_length == shoes.episode_length
    assert compose(shoes, updates=9).ppo.decay_updates == 9.0
    assert compose(shoes, updates=9, ppo={"decay_updates": 5.0}).ppo.decay_updates == 5.0


def with_sizes(task, **sizes: TrainingSize):
    """A copy of the task that sets sizes of policy training by preset."""
    other = copy.copy(task)
    other.training_sizes = sizes
    return other


def test_a_task_sets_the_size_of_its_training_by_preset(carry):
    ppo = {"num_envs": 64, "episode_length": 10, "progress": True, "discount": 0.9}
    task = with_sizes(carry, cpu=TrainingSize(7, ppo))
    settings, usual = compose(task, preset="cpu"), compose(carry, preset="cpu")
    assert (settings.updates, settings.ppo.decay_updates, settings.ppo.discount) == (7, 7.0, 0.9)
    expected = {name: value for name, value in ppo.items() if name != "discount"}
    assert settings.ppo_config == replace(usual.ppo_config, **expected)
    assert settings.ppo == replace(usual.ppo, discount=0.9, decay_updates=7.0)
    assert settings.pretrain_config == usual.pretrain_config and settings.episodes == usual.episodes
    # What is asked for goes over it, and other presets know nothing of it.
    asked = compose(task, preset="cpu", updates=3, ppo={"num_envs": 32, "discount": 0.5, "progress": False})
    assert (asked.updates, asked.ppo.decay_updates, asked.ppo.discount) == (3, 3.0, 0.5)
    assert (asked.ppo_config.num_envs, asked.ppo_config.episode_length) == (32, 10) and not asked.ppo_config.progress
    for preset in ("smoke", "gpu"):
        assert compose(task, preset=preset) == compose(carry, preset=preset)
    fixed = with_sizes(carry, cpu=TrainingSize(7, {"decay_updates": 70.0}))
    assert compose(fixed).ppo.decay_updates == compose(fixed, updates=3).ppo.decay_updates == 70.0
    with pytest.raises(ValueError, match="unknown field ppo.num_env; known fields: learning_rate, "):
        compose(with_sizes(carry, cpu=TrainingSize(7, {"num_env": 64})))


def test_shoes_in_box_trains_longer_than_a_preset_says_but_not_in_a_smoke_run():
    shoes = make_task("shoes_in_box")
    for preset, size in shoes.training_sizes.items():
        settings = compose(shoes, preset=preset)
        chosen = asdict(settings.ppo_config) | asdict(settings.ppo)
        assert settings.updates == size.updates and size.ppo.items() <= chosen.items()
        assert settings.ppo_config.decision_steps == shoes.decision_steps
        assert 0 < settings.ppo_config.retreat < settings.ppo_config.patience < shoes.episode_length
    smoke = compose(shoes, preset="smoke")
    assert set(shoes.training_sizes) == {"cpu", "gpu"}
    sizes = {"episode_length": shoes.episode_length, "decision_steps": shoes.decision_steps}
    assert smoke.ppo_config == replace(PRESETS["smoke"].ppo_config, **sizes)
    assert smoke.ppo == PPOHyper(decay_updates=float(PRESETS["smoke"].updates))


def test_episodes_have_to_be_whole_decisions():
    with pytest.raises(ValueError, match=r"episode_length is 7; allowed: a multiple of decision_steps \(4\)"):
        compose(make_task("shoes_in_box"), ppo={"episode_length": 7})


def test_a_robot_retreats_only_if_the_task_says_how(carry):
    with pytest.raises(ValueError, match="retreat is 2; allowed: 0, since task carry has no retreat_action"):
        compose(carry, ppo={"progress": True, "patience": 5, "retreat": 2})


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("reward", METHODS)
def test_json_gives_back_the_same_settings(carry, reward, preset):
    ablations, asked = METHODS[reward].ablations[:1], {"temperature": 0.125, "steps": 17}
    if METHODS[reward].encoder is None:
        asked = {"tau": 0.125}
    ppo = {"clip": 0.3, "num_envs": 512}
    settings = compose(carry, reward, preset, 3, "demos.npz", ablations, 12, "mjx", asked, ppo)
    assert settings.engine == "mjx"
    assert from_json(json.loads(json.dumps(as_json(settings)))) == settings
    assert hash(from_json(json.loads(json.dumps(as_json(settings)))).ppo_config) == hash(settings.ppo_config)


@pytest.mark.parametrize("path", ["seed", "demos", "pretrain.alpha", "ppo_config.num_envs", "pretrain_config.encoder",
                                  "pretrain_config.encoder.edges", "pretrain_config.encoder.pixels.size"])  # fmt: skip
@pytest.mark.parametrize("problem", ["missing", "unknown"])
def test_a_field_that_is_missing_or_unknown_is_an_error_that_names_it(carry, path, problem):
    values = as_json(compose(carry))
    *groups, field = path.split(".")
    group = values
    for name in groups:
        group = group[name]
    if problem == "missing":
        del group[field]
    else:
        path, group[f"{field}s"] = f"{path}s", group[field]
    with pytest.raises(ValueError, match=f"^settings: {path} is {problem}$"):
        from_json(values)


@pytest.mark.parametrize(
    "asked, message",
    [
        ({"reward": "money"}, "unknown reward 'money'; known rewards: graph, "),
        ({"preset": "huge"}, "unknown preset 'huge'; known presets: smoke, cpu, gpu"),
        ({"updates": 0}, "updates is 0; allowed: 1 or more"),
        ({"pretrain": {"steps": 0}}, "PretrainConfig.steps is 0; allowed: 1 or more"),
        ({"pretrain": {"alpha": math.inf}}, "pretrain.alpha is inf; allowed: 0 or more"),
        ({"ppo": {"clip": math.nan}}, "ppo.clip is nan; allowed: above 0"),
        ({"ppo": {"max_grad_norm": 0.0}}, "ppo.max_grad_norm is 0.0; allowed: above 0"),
        ({"pretrain": {"max_grad_norm": 0.0}}, "pretrain.max_grad_norm is 0.0; allowed: above 0"),
        ({"ppo": {"entropy_cost": -1.0}}, "ppo.entropy_cost is -1.0; allowed: 0 or more"),
        ({"ppo": {"discount": 1.1}}, "ppo.discount is 1.1; allowed: 0 to 1"),
        ({"pretrain": {"rearranged": 2.0}}, "pretrain.rearranged is 2.0; allowed: 0 to 1"),
        ({"ppo": {"num_envs": 5}}, r"num_envs is 5; allowed: a multiple of num_minibatches \(32\)"),
        ({"ppo": {"activation": "step"}}, "activation is 'step'; allowed: celu, elu, "),
        ({"pretrain": {"alhpa": 4.0}}, "unknown field pretrain.alhpa; known fields: learning_rate, "),
        ({"ppo": {"learning_rat": 1e-3}}, "unknown field ppo.learning_rat; known fields: learning_rate, "),
        ({"reward": "env", "pretrain": {"steps": 4}}, "pretrain.steps changes nothing about reward env; allowed: tau"),
        (
            {"pretrain": {"alpha": 2.0}, "ablations": ("activity",)},
            "pretrain.alpha is asked for, but an ablation of activity sets it",
        ),
    ],
)
def test_a_value_that_is_not_allowed_is_an_error_that_names_it(carry, asked, message):
    with pytest.raises(ValueError, match=message):
        compose(carry, **asked)


@pytest.mark.parametrize(
    "path, value, allowed",
    [
        ("seed", "a", "int"),
        ("seed", True, "int"),
        ("updates", 1.5, "int"),
        ("demos", 3, "str or NoneType"),
        ("engine", 3, "str or NoneType"),
        ("preset", "nonsense", "smoke, cpu, gpu"),
        ("pretrain.alpha", "2", "float"),
        ("pretrain_config.activity", True, "str"),
        ("pretrain_config.encoder.kind", 0, "str"),
        ("ppo_config.policy_hidden", [8.5], "int"),
        ("ppo_config.policy_hidden", "8", "a list"),
        ("ppo", None, "an object of learning_rate, "),
    ],
)
def test_a_value_of_another_type_is_an_error_that_names_it(carry, path, value, allowed):
    values = json.loads(json.dumps(as_json(compose(carry))))
    *groups, field = path.split(".")
    group = values
    for name in groups:
        group = group[name]
    group[field] = value
    with pytest.raises(ValueError, match=f"{path.split('.')[0]}.*(allowed|known presets): .*{allowed}"):
        from_json(values)


def test_json_writes_whole_floats_as_it_likes(carry):
    values = json.loads(json.dumps(as_json(compose(carry))))
    values["pretrain"]["alpha"] = 2
    assert from_json(values) == compose(carry)


def test_a_policy_of_a_set_gets_its_sizes_from_the_task():
    task = make_task("match_regions_layout")
    config = compose(task, "env", ppo={"policy": "set"}).ppo_config
    assert (config.policy, config.nodes) == ("set", (8, 24)) and compose(task, "env").ppo_config.nodes == ()
    with pytest.raises(
        ValueError, match="task shoes_in_box has no objects for a policy of a set; allowed: policy 'flat'"
    ):
        compose(make_task("shoes_in_box"), "env", ppo={"policy": "set"})
