"""GraphIRL's encoder and the ablations: what each leaves out, and that all of them run as one reward like any other."""

import json
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from synthetic import OBJECTS, demonstrations, overwrite_slot, random_graph
from test_commands import TRAIN, call

from graphrl_jax import cli, encoder, layers, pipeline, pretrain
from graphrl_jax.encoder import INPUT_SCALE, EncoderConfig
from graphrl_jax.graph import activity
from graphrl_jax.pretrain import PretrainConfig, PretrainHyper
from graphrl_jax.settings import ABLATIONS, Settings
from graphrl_jax.task import make_task

pytestmark = pytest.mark.usefixtures("outside_package")
CONFIG = EncoderConfig(hidden=8, embedding=5, kind="interaction")
PARAMS = encoder.init(jax.random.key(0), CONFIG, num_classes=3, num_slots=5)


def by_loops(params: encoder.EncoderParams, boxes: np.ndarray, there: list[int], pooled: list[int]) -> np.ndarray:
    """GraphIRL's embedding, node by node: what one is, what it has to do with every other, and the mean of both."""

    def features(i: int) -> np.ndarray:
        distances = np.zeros(len(boxes))
        for j in there:
            distances[j] = np.hypot(*(boxes[i, :2] - boxes[j, :2])) if j != i else 0.0
        return INPUT_SCALE * np.concatenate([boxes[i] - 0.5, distances])

    nodes = []
    for i in pooled:
        own = layers.perceptron(params["own"], features(i))
        related = [layers.perceptron(params["relation"], np.concatenate([features(i), features(j)]))
                   for j in there if j != i]  # fmt: skip
        nodes.append(layers.perceptron(params["affector"], jax.nn.relu(own + sum(related))))
    return np.mean(nodes, axis=0)


def test_the_interaction_network_is_graphirls():
    graph = random_graph(3)
    there = np.flatnonzero(graph.mask).tolist()
    found = encoder.encode(PARAMS, graph, 1.0, 0.0, 1.0)
    np.testing.assert_allclose(found, by_loops(PARAMS, np.asarray(graph.boxes), there, there), rtol=2e-4, atol=2e-4)


def test_without_the_robot_graphirl_does_not_know_of_it():
    graph = random_graph(3)
    moved = replace(graph, boxes=jnp.where(graph.robot[:, None], 0.9, graph.boxes))
    left_out = [encoder.encode(PARAMS, g, 1.0, 1.0, 0.0) for g in (graph, moved)]
    with_it = [encoder.encode(PARAMS, g, 1.0, 0.0, 1.0) for g in (graph, moved)]
    np.testing.assert_allclose(*left_out, atol=1e-6)
    assert not np.allclose(*with_it, atol=1e-3)


def test_masked_slots_take_part_in_nothing():
    graph = random_graph(3)
    found = [encoder.encode(PARAMS, g, 1.0, 0.0, 1.0) for g in (graph, overwrite_slot(graph, 4, np.nan))]
    np.testing.assert_allclose(*found, atol=1e-6)


def test_an_encoder_without_edges_is_one_whose_edges_weigh_nothing():
    config = EncoderConfig(hidden=8, embedding=5)
    params = encoder.init(jax.random.key(1), config, OBJECTS.num_classes)
    bare = encoder.init(jax.random.key(1), replace(config, edges=False), OBJECTS.num_classes)
    assert all("edge" not in layer for layer in bare["layers"])
    weightless = {**params, "layers": tuple({**layer, "edge": 0 * layer["edge"]} for layer in params["layers"])}
    graph = random_graph(4)
    expected = encoder.encode(weightless, graph, 2.0, 1.0)
    np.testing.assert_allclose(encoder.encode(bare, graph, 2.0, 1.0), expected, atol=1e-6)
    assert not np.allclose(encoder.encode(params, graph, 2.0, 1.0), expected, atol=1e-3)


def test_without_persistence_only_what_moves_is_active():
    boxes = np.full((4, 2, 4), 0.1, np.float32)
    boxes[:, 0, 0] = [0.2, 0.3, 0.3, 0.4]
    mask = np.ones((4, 2), bool)
    np.testing.assert_array_equal(activity(boxes, mask, 0.1)[:, 0], [False, True, True, True])
    np.testing.assert_array_equal(activity(boxes, mask, 0.1, persistent=False)[:, 0], [False, True, False, True])
    assert not activity(boxes, mask, 0.1, persistent=False)[:, 1].any()


@pytest.mark.parametrize("rearranged", [0.0, 1.0])
def test_pretraining_without_persistence_sees_fewer_active_objects(rearranged):
    demos = demonstrations()
    last = demos.lengths - 1
    boxes = demos.boxes.copy()
    boxes[np.arange(len(demos)), last] = boxes[np.arange(len(demos)), last - 1]  # they end at rest
    data = pretrain.prepare(replace(demos, boxes=boxes))
    hyper = PretrainHyper(rearranged=rearranged, bumped_before=0.0, tau=0.05)
    seen = [
        np.asarray(pretrain.shown_frames(PretrainConfig(persistent=kept), hyper, data, jax.random.key(0)).active)
        for kept in (True, False)
    ]
    # At the end everything that was moved counts as active, or only what still moves: in a rearrangement, what is
    # brought last.
    assert seen[0][:, 2].sum() > seen[1][:, 2].sum()
    assert seen[1][:, 2].any() == bool(rearranged)


def test_settings_say_what_is_left_out():
    task = make_task("carry")
    graphirl = pipeline.pretrain_hyper(task, 2.0, "graphirl")
    assert (graphirl.alpha, graphirl.reconstruction_weight) == (1, 0)
    assert (graphirl.suppress_robot, graphirl.robot_messages) == (1, 0)
    with_robot = pipeline.pretrain_hyper(task, 2.0, "graphirl_with_robot")
    assert (with_robot.suppress_robot, with_robot.robot_messages, with_robot.alpha) == (0, 1, 1)
    ablated = pipeline.pretrain_hyper(task, 2.0, "graph", ("activity", "reconstruction"))
    assert (ablated.alpha, ablated.reconstruction_weight, ablated.suppress_robot) == (1, 0, 1)
    assert Settings(reward="graphirl").pretraining.encoder.kind == "interaction"
    assert not Settings(ablations=("edges",)).pretraining.encoder.edges
    assert not Settings(ablations=("persistence",)).pretraining.persistent
    assert Settings(tcc_variant="classification").pretraining.tcc_variant == "classification"
    with pytest.raises(ValueError, match="'robot'; known ablations: reconstruction, activity, persistence, edges"):
        Settings(ablations=("robot",))  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="ablation 'edges' changes nothing about reward 'graphirl'"):
        Settings(reward="graphirl", ablations=("edges",))
    with pytest.raises(ValueError, match="variant of the TCC 'x'; known: regression_mse"):
        Settings(tcc_variant="x")  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "arguments",
    [["--reward", "graphirl"], ["--reward", "xirl"], ["--ablate", *ABLATIONS, "--tcc", "classification"]],
)
def test_each_trains_is_evaluated_and_resumed_like_any_other(tmp_path, arguments):
    out = tmp_path / "run"
    call(cli.train_main, *TRAIN, *arguments, "--out", out)
    config = json.loads((out / "config.json").read_text())
    assert config["reward"] == (arguments[1] if arguments[0] == "--reward" else "graph")
    outcome = call(cli.main, "evaluate", out, "--episodes", "4", "--video-episodes", "0")
    assert outcome["episodes"] == 4
    again = call(cli.train_main, "--out", out, "--resume")
    assert again["episodes"] == json.loads((out / "summary.json").read_text())["episodes"]
    found = call(cli.main, "stages", out, "--demos", out / "demonstrations.npz")
    assert found["demonstrations"] == 10
