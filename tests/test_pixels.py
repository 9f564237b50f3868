"""XIRL's network against loops over pixels, and its reward in an environment."""

import json
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from test_commands import TRAIN, call

from graphrl_jax import cli, pipeline, pixels, pretrain
from graphrl_jax.encoder import EncoderConfig
from graphrl_jax.landscape import audit
from graphrl_jax.pixels import PixelConfig
from graphrl_jax.pretrain import PretrainConfig
from graphrl_jax.reward import demonstration_rewards, fit_reward
from graphrl_jax.task import make_task
from graphrl_jax.wrappers import PixelReward

pytestmark = pytest.mark.usefixtures("outside_package")
CONFIG = PixelConfig(size=8, patch=2, widths=(3, 4), blocks=1)
PARAMS = pixels.init(jax.random.key(0), CONFIG, 5)
PICTURE = np.random.default_rng(0).uniform(size=(8, 8, 3)).astype(np.float32)


def convolved(layer: dict, features: np.ndarray, stride: int, before: int) -> np.ndarray:
    """A convolution by loops; `before` rows and columns of zeros lie above and to the left."""
    weight, bias = (np.asarray(layer[name]) for name in ("weight", "bias"))
    side, length = weight.shape[0], len(features)
    padded = np.pad(features, ((before, side), (before, side), (0, 0)))
    places = range(0, length, stride)
    rows = [[np.einsum("ijc,ijco->o", padded[y : y + side, x : x + side], weight) + bias for x in places]
            for y in places]  # fmt: skip
    return np.array(rows)


def test_the_network_is_residual_convolutions():
    features = 2 * PICTURE - 1
    for number, stage in enumerate(PARAMS["stages"]):
        # A 3 x 3 kernel of stride 2 over an even length has its padding at the end.
        features = np.maximum(convolved(stage["in"], features, 2, 0), 0)
        assert features.shape[0] == (4, 2)[number]
        for first, second in stage["blocks"]:
            inner = np.maximum(convolved(first, standardised(features), 1, 1), 0)
            features = features + convolved(second, standardised(inner), 1, 1)
    output = PARAMS["output"][0]
    expected = features.ravel() @ np.asarray(output["weight"]) + np.asarray(output["bias"])
    np.testing.assert_allclose(pixels.encode(PARAMS, PICTURE), expected, rtol=1e-3, atol=1e-3)


def standardised(features: np.ndarray) -> np.ndarray:
    return (features - features.mean(-1, keepdims=True)) / np.sqrt(features.var(-1, keepdims=True) + 1e-5)


def test_bytes_are_seen_as_their_share_of_255():
    as_bytes = np.round(255 * PICTURE).astype(np.uint8)
    np.testing.assert_allclose(
        pixels.encode(PARAMS, as_bytes), pixels.encode(PARAMS, as_bytes.astype(np.float32) / 255), atol=1e-5
    )


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"size": 60}, "PixelConfig.size must be a multiple of 16, got 60"),
        ({"widths": ()}, "PixelConfig.widths must be positive"),
        ({"patch": 0}, "PixelConfig.patch must be at least 1, got 0"),
    ],
)
def test_sizes_that_do_not_fit_are_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        replace(PixelConfig(), **changes)


def test_the_resnet_has_as_many_convolutions_as_resnet_18():
    params = jax.eval_shape(lambda key: pixels.init(key, pixels.RESNET_18, 32), jax.random.key(0))
    assert sum(leaf.ndim == 4 for leaf in jax.tree.leaves(params)) == 20  # as ResNet-18's, three shortcuts included
    assert 11e6 < sum(leaf.size for leaf in jax.tree.leaves(params)) < 15e6  # ResNet-18 has 11.2 M


@pytest.fixture(scope="module")
def learned():
    """Task, demonstrations with pictures and a reward of an encoder that saw none of them."""
    task = make_task("carry")
    demos = task.demonstrate(jax.random.key(0), 6, picture_size=8)
    return task, demos, fit_reward(PARAMS, demos, 1.0, 0.0, 0.02, picture_size=8)


def test_the_reward_falls_with_the_distance_of_pictures_to_the_last_ones(learned):
    _, demos, model = learned
    embed = jax.vmap(pixels.encode, (None, 0))
    goal = embed(PARAMS, demos.frames[:, -1]).mean(0)
    np.testing.assert_allclose(model.goal, goal, rtol=1e-4, atol=1e-5)
    expected = -model.kappa * jnp.linalg.norm(embed(PARAMS, demos.frames[0]) - goal, axis=-1)
    np.testing.assert_allclose(demonstration_rewards(model, demos)[0], expected, rtol=1e-3, atol=1e-4)
    with pytest.raises(ValueError, match="frames must be pictures of 8 x 8 pixels, got none"):
        demonstration_rewards(model, replace(demos, frames=None))


def test_an_environment_pays_for_the_picture_after_the_step(learned):
    task, _, model = learned
    env = PixelReward(task, model)
    state = env.step(env.reset(jax.random.key(1)), jnp.array([1.0, 0.0]))
    picture = task.picture(state.pipeline_state, 8)
    np.testing.assert_allclose(state.reward, model.apply(picture), rtol=1e-5)
    assert float(state.metrics["learned_reward"]) == float(state.reward) != float(state.metrics["env_reward"])


def test_an_audit_shows_it_pictures(learned):
    task, _, model = learned
    landscape = task.landscape(jax.random.key(2))
    report = audit(model, landscape, pipeline.picture_of(task, model))
    state = jax.tree.map(lambda leaf: leaf[3, 5], landscape.grids[0].scenes.states)
    np.testing.assert_allclose(report.grids[0].values[3, 5], model.apply(task.picture(state, 8)), rtol=1e-3, atol=1e-4)
    assert report.bump_bonus == 0.0  # pictures know of no activity


def test_pretraining_aligns_pictures():
    demos = make_task("carry").demonstrate(jax.random.key(0), 8, picture_size=16)
    sizes = PixelConfig(size=16, patch=4, widths=(16,))
    config = PretrainConfig(200, 8, 20, EncoderConfig(embedding=8, kind="pixels", pixels=sizes))
    hyper = pretrain.PretrainHyper(temperature=0.1)
    _, history = pretrain.train(config, hyper, pretrain.prepare(demos, 16), jax.random.key(1))
    # What lies still at the end cannot be told apart, nor can its time.
    assert history["loss"][-10:].mean() < 0.5 * history["loss"][:3].mean()
    np.testing.assert_array_equal(history["box"], 0.0)


def test_what_cannot_be_seen_is_refused_before_anything_is_written(tmp_path, capsys):
    out, file = tmp_path / "run", tmp_path / "demos.npz"
    call(cli.main, "demos", "--task", "carry", "--num", "4", "--pictures", "16", "--out", file)
    for arguments, message in (
        (["--task", "shoes_in_box"], "task shoes_in_box cannot be drawn inside a program"),
        (["--task", "carry", "--ablate", "edges"], "ablation 'edges' changes nothing about reward 'xirl'"),
    ):
        with pytest.raises(SystemExit):
            cli.train_main(["--preset", "smoke", "--reward", "xirl", *arguments, "--out", str(out)])
        assert message in capsys.readouterr().err and not out.exists()
    with pytest.raises(SystemExit):
        cli.train_main([*TRAIN, "--reward", "xirl", "--demos", str(file), "--out", str(out)])
    assert "frames must be pictures of 32 x 32 pixels, got those of 16 x 16" in capsys.readouterr().err


def test_floats_that_pictures_do_not_know_cannot_be_swept(tmp_path, capsys):
    arguments = ["sweep", "--task", "carry", "--reward", "xirl", "--alphas", "1,2", "--out", str(tmp_path / "sweep")]
    with pytest.raises(SystemExit):
        cli.main(arguments)
    error = capsys.readouterr().err
    assert "pretrain.alpha" in error and "pretrain.temperature" in json.dumps(error)
