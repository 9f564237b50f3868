"""Which object sits in which slot."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from graphrl_jax.graph import build_graph
from tasks.match_regions import geometry, layouts, variants
from tasks.match_regions.objects import class_ids, scene_of_boxes, variant_objects
from tests.helpers.match_regions import TASK


def test_classes_say_colour_and_shape() -> None:
    objects = variant_objects(variants.BLOCKS)
    world = jax.jit(variants.VARIANTS["all"].sample)(jax.random.key(2)).world
    names = [objects.class_names[index] for index in class_ids(world)]
    assert names[0] == f"{layouts.COLOURS[world.region_colour]}_region" and names[1] == "robot"
    expected = [f"{layouts.COLOURS[c]}_{geometry.SHAPES[s]}" for c, s in zip(world.colours, world.shapes, strict=True)]
    assert names[2:] == expected
    graph = build_graph(objects, jnp.zeros((10, 4)), jnp.ones(10, bool), jnp.zeros(10, bool), class_ids(world))
    np.testing.assert_array_equal(np.argmax(graph.classes, axis=1), class_ids(world))


@pytest.mark.parametrize("variant", [None, "all"])
def test_a_scene_is_known_again_by_its_boxes_and_angles(variant):
    task = TASK if variant is None else variants.make(variant)
    start = jax.jit(task.layout.sample)(jax.random.key(3))
    boxes, mask = task.scene_boxes(start.qpos, start.world)
    classes = jnp.asarray(task.objects.class_ids) if variant is None else class_ids(start.world)
    spare = mask.shape[0] - 2 - task.layout.blocks
    angles = jnp.concatenate([jnp.zeros(1), start.qpos[2:3], start.qpos[7::3], jnp.zeros(spare)])
    qpos, world = jax.jit(scene_of_boxes, static_argnums=0)(task.objects, boxes, mask, classes, angles)
    there = np.asarray(start.world.present)
    known = 5 + 3 * task.layout.blocks
    shown = np.concatenate([np.ones(5, bool), np.repeat(there, 3)])
    np.testing.assert_allclose(np.asarray(qpos)[:known][shown], np.asarray(start.qpos)[shown], atol=1e-5)
    np.testing.assert_allclose(world.region, start.world.region, atol=1e-5)
    assert world.region_colour == start.world.region_colour
    for name in ("colours", "shapes", "present"):
        found, expected = (np.asarray(getattr(one, name)) for one in (world, start.world))
        np.testing.assert_array_equal(found[: len(there)][there], expected[there])
    assert not np.asarray(world.present)[len(there) :].any()
